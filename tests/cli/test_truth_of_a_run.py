"""`truth` of a config: the error against a finer run, in the summary and in words."""

import json

import pytest
from cli_runs import SCENE, run, scene_file, sets, succeed

from jaxthermo.archive import write_archive
from jaxthermo.cli.truth import error_in_words
from jaxthermo.config.loader import load_config
from jaxthermo.errors import InputError
from jaxthermo.integrate.run.solution_arrays import FORMAT_VERSION


FOUND = {
    "reference": "fine/solution.npz",
    "worst_rms_kelvin": 0.3204,
    "worst_rms_percent": 2.541,
    "worst_p99_kelvin": 1.25,
    "worst_bias_kelvin": -0.0512,
    "worst_lost_fraction": 0.0123,
    "remarks": ["voxels"],
}


def test_kelvin_come_first_in_words():
    line, remark = error_in_words(FOUND)
    assert line == (
        "error against fine/solution.npz: 0.32 K (2.54 %) RMS at the worst time, 99 % "
        "of the surface within 1.25 K, mean -0.0512 K; 1.23 % of its surface is not in "
        "these voxels"
    )
    assert remark == "note: voxels"
    # A reference of one temperature has no percentage; nothing lost is not said.
    (line,) = error_in_words(
        {**FOUND, "worst_rms_percent": None, "worst_lost_fraction": 0.0, "remarks": []}
    )
    assert "0.32 K RMS at the worst" in line and "surface is not" not in line


def test_a_reference_that_is_not_there_is_named_with_its_key(tmp_path):
    scene = scene_file(tmp_path, SCENE + "truth: {reference: fine.npz}\n")
    with pytest.raises(InputError, match=r"truth.reference: there is no file"):
        load_config(scene)


@pytest.mark.slow
@pytest.mark.slice
def test_a_run_is_compared_with_a_finer_one(tmp_path, scene, out):
    fine = tmp_path / "fine"
    succeed("simulate", scene, "--out", fine, "--set", "bodies.0.voxels_high=24")
    truth = f"truth={{reference: {fine / 'solution.npz'}, points: 2000}}"
    said = succeed("simulate", scene, "--out", out, "--set", truth)
    error = json.loads((out / "summary.json").read_text())["truth_error"]
    assert error["times_s"] == [5, 12, 20]
    assert error["pitch_m"] == pytest.approx([0.1 / 12])
    assert error["reference_pitch_m"] == pytest.approx([0.1 / 24])
    assert 0 < error["worst_rms_kelvin"] == max(error["rms_kelvin"]) < 0.5
    assert 0 < error["worst_rms_percent"] < 20
    assert error["worst_lost_fraction"] == error["reference_lost_fraction"] == 0
    assert error["remarks"] == []
    assert f"{error['worst_rms_kelvin']:.3g} K" in " ".join(said.split())
    # The run itself does not depend on what it is compared with.
    fine_summary = json.loads((fine / "summary.json").read_text())
    assert fine_summary["truth_error"] is None

    # A run that is no finer says so; one that is written over is refused.
    same = f"truth={{reference: {out / 'solution.npz'}}}"
    code, said, _ = run("simulate", scene, "--out", tmp_path / "again", "--set", same)
    assert code == 0 and "has the voxels of the reference" in " ".join(said.split())
    code, _, err = run("simulate", scene, "--out", out, "--set", same)
    assert code == 2 and err.count("\n") == 1
    assert "would be written over by the run" in err
    # What does not fit is said before the run, and nothing is written.
    old = tmp_path / "old.npz"
    write_archive(old, "solution", FORMAT_VERSION - 1, {})
    larger = "bodies.0.shape={kind: box, size: [5 cm, 4 cm, 16 cm]}"
    refused = {
        "nothing is saved at 13 s there": (same, "time.save_at=[5, 13]"),
        "the mesh of body 0 ends up to": (same, larger),
        f"format version {FORMAT_VERSION - 1}": (f"truth={{reference: {old}}}",),
    }
    for words, changes in refused.items():
        options = sets(*changes)
        code, _, err = run("simulate", scene, "--out", tmp_path / "b", *options)
        assert code == 2 and err.count("\n") == 1 and words in err, err
        assert "truth.reference: " in err and not (tmp_path / "b").exists()
