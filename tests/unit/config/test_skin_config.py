"""`skin` in scene files: its number of cells, its place, and mistakes."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

import jaxthermo as jt
from jaxthermo.config.schema.scene import SceneConfig
from jaxthermo.config.strict_yaml import read_yaml


ROOF = Path("tests/data/mesh_and_heat/roof_skin.yaml")


def roof(skin, **changes):
    data = read_yaml(ROOF)
    data["bodies"][0]["skin"] = skin
    data |= changes
    return data


def skin_of(data) -> jt.Skin:
    skin = SceneConfig.model_validate(data).build().bodies[0].structure
    assert isinstance(skin, jt.Skin)
    return skin


def test_a_skin_is_where_terms_act():
    skin = skin_of(roof({"cells": 6}))
    assert skin.cells == 6
    normal = skin.grid.fragment_normal
    assert (normal[np.asarray(skin.fragment_node()) < 24] @ [1, 0, 0] > 0.9).all()
    everywhere = skin_of(roof({"cells": 6}, outdoors=None, terms=[]))
    assert everywhere.on is None
    side = {"side": {"normal": [0, 0, 1]}}
    elsewhere = skin_of(roof({"cells": 6, "on": side}))
    assert elsewhere.node_count == 24 + 6 * 12


@pytest.mark.parametrize("skin", ["auto", {"cells": "auto"}, {"on": None}])
def test_cells_follow_from_the_interval_of_saved_times(skin):
    alpha = 1.4 / (2300 * 880)
    cells = jt.Skin.cells_for(0.5, diffusivity=alpha, time=3600.0)
    assert skin_of(roof(skin)).cells == cells
    sooner = {"cells": "auto", "shortest_time": "1 min"}
    assert skin_of(roof(sooner)).cells > cells


@pytest.mark.parametrize(
    ("skin", "message"),
    [
        ({"cells": 0}, "cells"),
        ({"cells": 33}, "cells"),
        ({"depth": 1}, "depth"),
        ({"shortest_time": 0}, "shortest_time"),
    ],
)
def test_mistakes_name_the_key(skin, message):
    with pytest.raises(ValidationError, match=message):
        SceneConfig.model_validate(roof(skin))


def test_a_sheet_has_no_skin():
    data = roof({"cells": 6})
    body = data["bodies"][0]
    del body["pitch"], body["material"]
    body["sheet"] = {"layers": [{"material": "steel", "thickness": "1 mm"}]}
    with pytest.raises(ValidationError, match="a `sheet` has `cells` through"):
        SceneConfig.model_validate(data)
