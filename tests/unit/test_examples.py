"""The examples in the docstrings of the names that are used most run as they stand."""

import doctest

import pytest

import jaxthermo as jt


NAMES = (
    "voxelize",
    "FullVolume",
    "Material",
    "Body",
    "Scene",
    "Sun",
    "Convection",
    "simulate",
    "steady",
    "render",
    "mesh_sample",
    pytest.param("truth_error", marks=pytest.mark.slow),
)


@pytest.mark.parametrize("name", NAMES)
def test_example_runs(name):
    examples = doctest.DocTestFinder(recurse=False).find(
        getattr(jt, name), name, globs={}
    )
    assert len(examples) == 1 and examples[0].examples
    runner = doctest.DocTestRunner()
    assert runner.run(examples[0]).failed == 0
