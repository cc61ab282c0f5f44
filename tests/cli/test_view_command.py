"""`jaxthermo view` and `jaxthermo play`: mistakes in one line, and the page itself."""

import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from cli_runs import SCENE, refused, run, scene_file
from PIL import Image
from playwright.sync_api import sync_playwright


ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
# WebGL without a graphics processor.
BY_SOFTWARE = (
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    "--no-sandbox",
)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("view", "no.yaml"), "no.yaml"),
        (("view", "CONFIG", "--port", "70000"), "give a number from 0 to 65535"),
        (("view", "CONFIG", "--host", "192.0.2.1"), "cannot listen there"),
        (("view", "CONFIG", "--rate", "0", "--port", "0"), "rate 0"),
        (("view", "CONFIG", "--rate", "nan", "--port", "0"), "rate nan"),
        (("view", "CONFIG", "--set", "terms.0.irradiance=-1"), "irradiance"),
        (("view", "CONFIG", "--set", "camera.position=[0, 0, 0]", "--port", "0"), "in"),
        (("play", "no-run"), "has no config.yaml"),
    ],
)
def test_a_mistake_is_one_line(arguments, words, scene):
    config = scene
    named = [config if word == "CONFIG" else word for word in arguments]
    assert words in refused(*named)
    # No thread of a server is left.
    assert not [t for t in threading.enumerate() if "_background_worker" in t.name]


def test_a_rate_of_play_must_be_positive(finished):
    code, _, err = run("play", finished, "--rate", "-1", "--port", "0")
    assert code == 2 and "rate -1" in err and err.count("\n") == 1


@pytest.mark.parametrize("arguments", [("view", "a.yaml"), ("play", "a")])
def test_without_the_extra_a_line_says_how_to_install_it(arguments, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert "pip install '.[view]'" in err and err.count("\n") == 1


def begin(*arguments: object) -> tuple[subprocess.Popen[str], str]:
    """A command that serves a page, and the page's address."""
    command_line = [
        sys.executable,
        "-m",
        "jaxthermo",
        *map(str, arguments),
        "--port",
        "0",
    ]
    started = subprocess.Popen(
        command_line,
        cwd=ROOT,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert started.stdout is not None
    line = started.stdout.readline()
    match = re.search(r"http://127\.0\.0\.1:\d+", line)
    if match is None:
        started.kill()
        raise AssertionError(line + started.communicate()[1])
    return started, match[0]


def end(started: subprocess.Popen[str]) -> None:
    """Ctrl-C, which ends a command cleanly."""
    started.send_signal(signal.SIGINT)
    try:
        out, err = started.communicate(timeout=30)
    finally:
        started.kill()
    assert (started.returncode, out, err) == (0, "", "")


def looked_at(address: str, path: Path) -> tuple[np.ndarray, str]:
    """Press play, and look: the middle of the page, and all text on it."""
    with sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=CHROMIUM, args=BY_SOFTWARE)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        # Drawn by software, beside other tests, a picture may take seconds.
        page.set_default_timeout(180_000)
        mistakes: list[str] = []
        page.on("pageerror", lambda error: mistakes.append(str(error)))
        page.goto(address)
        page.get_by_text("paused").wait_for()
        page.get_by_role("button", name="Play").click()
        page.get_by_text("frames/s").wait_for()
        box = page.locator("canvas").first.bounding_box()
        assert box is not None
        middle_x = box["x"] + box["width"] / 2
        middle_y = box["y"] + box["height"] / 2
        page.mouse.click(middle_x, middle_y)
        page.locator(".uplot canvas").first.wait_for()
        # Both speeds are measured over two seconds.
        page.get_by_text(re.compile(r"\d simulated s/s, \d")).wait_for()
        page.screenshot(path=path)
        text = page.locator("body").inner_text()
        browser.close()
    assert not mistakes
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    x = round(middle_x)
    y = round(middle_y)
    return picture[y - 150 : y + 150, x - 150 : x + 150], text


def check_page(arguments: tuple[object, ...], words: list[str], path: Path) -> None:
    """Start a command, press play in a browser, look, and end the command."""
    started, address = begin(*arguments)
    try:
        middle, text = looked_at(address, path)
        assert started.poll() is None
    finally:
        end(started)
    # The body covers the middle, in many colours of the palette.
    assert len(np.unique(middle.reshape(-1, 3), axis=0)) > 50
    assert np.ptp(middle, axis=2).max() > 60
    for word in ["running", "surface temperature", "scene's camera", *words]:
        assert word in text


without_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="there is no Chromium on this computer"
)


@pytest.mark.slow
@pytest.mark.slice
@without_browser
def test_the_page_shows_a_simulation_that_runs(tmp_path):
    scene = SCENE.replace("end: 20, save_at: [5, 12, 20]", "end: 2 h, save_at: [2 h]")
    words = ["Sun", "azimuth [°]", "Build and start again"]
    command_words = "view", scene_file(tmp_path, scene), "--rate", "2"
    check_page(command_words, words, tmp_path / "page.png")


@pytest.mark.slow
@without_browser
def test_the_page_shows_a_finished_run(finished, tmp_path):
    command_words = "play", finished, "--rate", "0.2"
    check_page(command_words, ["time [s]"], tmp_path / "page.png")
