"""Mark of tests whose cells are too coarse for their loads in time, on purpose."""

import pytest


SHALLOW = pytest.mark.filterwarnings("ignore:.* a change of its loads heat has gone")
