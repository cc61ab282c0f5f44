"""Picture of the live view, `live.webp`: needs Chromium and playwright.

`jaxthermo view` runs the figurine for a while; a click sets a probe on its robe.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from make_pictures import ROOT, write_small
from PIL import Image
from playwright.sync_api import sync_playwright


# WebGL without a graphics processor.
_BROWSER = (
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
)
_WIDTH = 1280
_HEIGHT = 800
_WAIT_MS = 20_000
_COMMAND = ("jaxthermo", "view", "configs/scenes/figurine.yaml", "--port", "0")


def _screenshot(address: str, path: Path) -> None:
    with sync_playwright() as tool:
        chromium = shutil.which("chromium") or shutil.which("google-chrome")
        browser = tool.chromium.launch(executable_path=chromium, args=_BROWSER)
        page = browser.new_page(viewport={"width": _WIDTH, "height": _HEIGHT})
        page.goto(address)
        page.get_by_text("paused").wait_for(timeout=120_000)
        page.get_by_role("button", name="Play").click()
        page.get_by_text("frames/s").wait_for(timeout=60_000)
        box = page.locator("canvas").first.bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.locator(".uplot canvas").first.wait_for(timeout=60_000)
        page.wait_for_timeout(_WAIT_MS)
        # The browser's remark that it draws without a graphics processor.
        for notice in page.locator(".mantine-Notification-closeButton").all():
            notice.click()
        page.locator(".mantine-Notification-root").first.wait_for(state="detached")
        page.screenshot(path=path)
        browser.close()


def main() -> None:
    """Start the view, take the picture and end the view."""
    command = [sys.executable, "-u", "-m", *_COMMAND]
    started = subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE)
    assert started.stdout is not None
    try:
        address = re.search(r"http://127\.0\.0\.1:\d+", started.stdout.readline())
        assert address is not None, "the view names no address"
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "live.png"
            _screenshot(address[0], path)
            with Image.open(path) as image:
                write_small("live", image)
    finally:
        started.terminate()
        started.wait()


if __name__ == "__main__":
    main()
