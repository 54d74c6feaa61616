"""Mark points with `MarkPixels` in a real browser, and let `gem-lite set-up` take them in the next cell.

It needs what mark_action.py needs::

    /tmp/browser/bin/python tests/browser/mark_pixels.py
"""

import tempfile
import time
from pathlib import Path

import mark_action
from selenium.webdriver.common.keys import Keys

CELLS = (
    """import json, shutil, sys
from gem_lite import clip
from gem_lite.drawing.mark_pixels import MarkPixels
from gem_lite.rgbd.observation import read_raw
shutil.copytree(clip.DATA / "foreign-scenes" / "workbench", "my-scene")
view = read_raw("my-scene", posed=False)[0]""",
    """marks = MarkPixels(view.rgb)
marks""",
    """try:
    print(json.dumps(marks.numbers))
except ValueError as error:
    print(json.dumps(str(error)))""",
    """numbers = marks.numbers
out = !"{sys.executable}" -m gem_lite.cli set-up clicks my-scene {numbers} --camera "{view.name}"
print(json.dumps(out))""",
)


class Page(mark_action.Page):
    """The notebook with a picture in the browser."""

    prefix = ".gem-pixels"

    def press_pixel(self, x, y, kind="mouse"):
        """Press at a pixel of the picture, however large the page shows it."""
        box = self.canvas.rect
        scale = box["width"] / self.width
        self.press(y, x, pixels=scale, kind=kind)


def mark(page):
    assert page.action() == "0 of 2 points are marked: click the others in the picture"
    page.wait_for_hint("Click point 1 of 2.")
    page.press_pixel(200, 240)
    page.wait_for_hint("Click point 2 of 2.")
    page.press_pixel(420, 250, kind="touch")
    page.wait_for_hint("All points are marked.")
    assert page.action() == "200 240 420 250"
    page.press_pixel(300, 50)  # there is no third point
    assert page.action() == "200 240 420 250"
    page.press_pixel(204, 243)  # takes the first point there
    page.canvas.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_UP, Keys.ARROW_UP)  # moves this point
    assert page.action() == "205 241 420 250"
    page.find(".undo").click()
    page.find(".undo").click()
    page.canvas.send_keys(Keys.ENTER, Keys.ARROW_LEFT)
    assert page.action() == "1 of 2 points are marked: click the others in the picture"
    page.press_pixel(420, 250)
    assert page.action() == f"{page.width // 2 - 1} 240 420 250"


def set_up(page):
    said = "\n".join(page.action(3))
    assert "above the table" in said and "wrote the pose of" in said, said


def main():
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder, port = Path(name), mark_action.free_port()
        lab = mark_action.start_lab(folder, port, CELLS)
        try:
            with mark_action.start_browser(folder) as browser:
                page = mark_action.open_notebook(browser, port, Page)
                page.width = browser.execute_script("return arguments[0].width", page.canvas)
                mark(page)
                browser.execute_script("arguments[0].parentElement.style.width = '200px'", page.canvas)
                time.sleep(0.5)
                page.find(".undo").click()
                page.press_pixel(422, 252)
                x, y = (int(number) for number in page.action().split()[2:])
                assert abs(x - 422) <= 2 and abs(y - 252) <= 2, "a page that shows it smaller"
                set_up(page)
        finally:
            lab.terminate()
            lab.wait(30)
    print("all points were read back, and set-up took them")


if __name__ == "__main__":
    main()
