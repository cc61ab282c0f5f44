"""`fit.json`: what is written is what is read, and damage is one line."""

import json
import os

import pytest

import jaxthermo as jt
from calibrate.config.fit_record import read_fit, write_fit
from tests.calibrating import RESULT


def refused(path, words):
    with pytest.raises(jt.InputError, match=words) as caught:
        read_fit(path)
    message = str(caught.value)
    assert message.startswith(str(path)) and "\n" not in message


def test_what_is_written_is_read(tmp_path):
    path = tmp_path / "fit.json"
    write_fit(path, RESULT)
    assert read_fit(path) == RESULT
    # The order of its keys and the layout of its lines do not count.
    content = json.loads(path.read_text())
    path.write_text(json.dumps(dict(sorted(content.items()))))
    assert read_fit(path) == RESULT


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda text: "", "damaged"),
        (lambda text: text[: 2 * len(text) // 3], "damaged"),
        (lambda text: text.replace("1.2", "1.3"), "its checksum does not match"),
        (lambda text: text.replace('"format_version": 1', '"format_version": 7'), "7"),
        (lambda text: text.replace("calibration result", "x"), "not a calibration"),
        (lambda text: "[1, 2]", "not a calibration result"),
        (lambda text: "{}", "not a calibration result"),
        (lambda text: "[" * 100_000, "damaged"),
        (lambda text: text.replace("checksum", "sum"), "its checksum does not match"),
        (lambda text: "\x00\xff" + text, "damaged"),
    ],
)
def test_a_damaged_file_is_one_line(tmp_path, damage, words):
    path = tmp_path / "fit.json"
    write_fit(path, RESULT)
    path.write_text(damage(path.read_text()), encoding="latin-1")
    refused(path, words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"parameters": None}, "parameters: "),
        ({"loss": {"initial": 2.0}}, "loss.final: missing"),
        ({"advice": [{"what": "more", "gain_nats": "much"}]}, "advice.0.gain_nats: "),
        ({"error_percent": {"train": {"default": 1.0}}}, "train.fitted: missing"),
        ({"ended": 3}, "ended: expected a word"),
    ],
)
def test_a_file_with_a_right_checksum_and_wrong_content(tmp_path, change, words):
    path = tmp_path / "fit.json"
    write_fit(path, RESULT | change)
    refused(path, words)


def test_a_missing_file_and_a_pipe(tmp_path):
    refused(tmp_path / "fit.json", "`calibrate fit` makes it")
    os.mkfifo(tmp_path / "fit.json")
    refused(tmp_path / "fit.json", "a pipe or a device")
