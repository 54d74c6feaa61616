"""Mark an action with `MarkAction` in a real browser, and compare what the next cell prints with where it was clicked.

It needs Chromium with its driver (``apt install chromium chromium-driver``) and selenium in an environment of its own::

    python3 -m venv /tmp/browser && /tmp/browser/bin/pip install selenium
    /tmp/browser/bin/python tests/browser/mark_action.py

pytest does not collect it. It starts JupyterLab of this folder's .venv on this machine alone, with a notebook in a
temporary folder.
"""

import json
import math
import os
import socket
import subprocess
import tempfile
import time
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.pointer_input import PointerInput
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.wait import WebDriverWait

ROOT = Path(__file__).resolve().parents[2]
CELL, X_MIN, Y_MAX, PIXELS = 0.00625, 0.25, 0.5, 4
"""The default workspace, and how many pixels of the page a cell has."""
IS_READY = """
const panel = window.jupyterapp && [...window.jupyterapp.shell.widgets('main')][0];
if (!panel?.sessionContext) return false;
window.jupyterapp.shell.activateById(panel.id);
return panel.sessionContext.session?.kernel?.connectionStatus === 'connected';"""
"""The notebook is open and its kernel answers."""
SENTENCE = "put the red block in the blue bowl"
CELLS = (
    """from gem_lite import clip
from gem_lite.drawing.mark_action import MarkAction
from gem_lite.rgbd.heightmap import fuse_views
from gem_lite.rgbd.observation import Observation
from gem_lite.se2 import Workspace
kept = []
def keep(action, sentence):
    if "bowl" not in sentence:
        raise ValueError(f'no bowl in "{sentence}"')
    kept.append((action, sentence))
heightmap = fuse_views(Observation.load(clip.DATA / "foreign-scenes" / "workbench").views, Workspace())""",
    """widget = MarkAction(heightmap)
widget.on_keep(keep)
widget""",
    """import json
from dataclasses import asdict
try:
    print(json.dumps(asdict(widget.action) | {"is_kept": widget.is_kept, "kept": len(kept), "said": widget.sentence}))
except ValueError as error:
    print(json.dumps(str(error)))""",
)


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def start_lab(folder, port, sources=CELLS):
    cells = [
        {"cell_type": "code", "id": f"c{i}", "metadata": {}, "source": source, "outputs": [], "execution_count": None}
        for i, source in enumerate(sources)
    ]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    notebook = {"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}
    (folder / "mark.ipynb").write_text(json.dumps(notebook))
    settings = folder / "settings" / "@jupyterlab" / "apputils-extension"
    settings.mkdir(parents=True)
    (settings / "notification.jupyterlab-settings").write_text('{"fetchNews": "false", "checkForUpdates": false}')
    own = {f"JUPYTER_{name}_DIR": str(folder / name.lower()) for name in ("CONFIG", "DATA", "RUNTIME")}
    # Without a token: the folder is temporary, and only this machine reaches it.
    return subprocess.Popen(
        [ROOT / ".venv/bin/jupyter-lab", "--no-browser", "--allow-root", "--ip=127.0.0.1", f"--port={port}",
         "--IdentityProvider.token=", f"--ServerApp.root_dir={folder}", "--LabApp.expose_app_in_browser=True",
         f"--LabApp.user_settings_dir={folder / 'settings'}"],
        env=os.environ | own | {"PYTHONPATH": str(ROOT)}, cwd=folder,
        stdout=(folder / "lab.log").open("w"), stderr=subprocess.STDOUT,
    )  # fmt: skip


def start_browser(folder):
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    flags = ("headless=new", "no-sandbox", "disable-gpu", "no-first-run", "window-size=1200,1100", "disable-sync")
    for flag in (*flags, f"user-data-dir={folder / 'browser'}"):
        options.add_argument(f"--{flag}")
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService("/usr/bin/chromedriver"))
    browser.set_script_timeout(300)
    return browser


class Page:
    """The notebook in the browser."""

    prefix = ".gem-mark"

    def __init__(self, browser):
        self.browser = browser

    def wait(self, condition, seconds=120):
        return WebDriverWait(self.browser, seconds, 0.2).until(condition)

    def run_cell(self, number):
        """Run a cell as a person does who stands in it, and wait for its end."""
        self.browser.execute_async_script(
            """const [number, done] = arguments; const app = window.jupyterapp;
            const panel = [...app.shell.widgets('main')][0];
            app.shell.activateById(panel.id);
            panel.content.activeCellIndex = number;
            app.commands.execute('notebook:run-cell').then(() => done(), (error) => done(String(error)));""",
            number,
        )

    def action(self, cell=2):
        """What a cell prints."""
        time.sleep(1)  # Many marks within a moment reach the kernel one after the other.
        self.run_cell(cell)
        time.sleep(0.5)
        return json.loads(self.browser.find_elements(By.CSS_SELECTOR, ".jp-OutputArea-output pre")[-1].text)

    @property
    def canvas(self):
        return self.find("canvas")

    def find(self, selector):
        return self.browser.find_element(By.CSS_SELECTOR, f"{self.prefix} {selector}")

    def wait_for_hint(self, text):
        self.wait(lambda _: self.find(".hint").text == text)

    def undo_both(self):
        self.find(".undo").click()
        self.find(".undo").click()

    def press(self, row, col, degrees=None, way=60, kind="mouse", pixels=PIXELS):
        """Press at a cell's centre, drag by ``way`` pixels of the page in a direction, and let go."""
        box = self.canvas.rect
        x, y = round(box["x"] + (col + 0.5) * pixels), round(box["y"] + (row + 0.5) * pixels)
        pointer = PointerInput(kind, kind)
        chain = ActionChains(self.browser, duration=50, devices=[pointer])
        pointer.create_pointer_move(duration=0, x=x, y=y)
        pointer.create_pointer_down(button=0)
        if degrees is not None:
            turn = math.radians(degrees)
            for part in (0.3, 1.0):
                x_end, y_end = x + part * way * math.cos(turn), y - part * way * math.sin(turn)
                pointer.create_pointer_move(duration=30, x=round(x_end), y=round(y_end))
        pointer.create_pointer_up(button=0)
        chain.w3c_actions.perform()


def check_marks(page, pick, place):
    """The last cell prints both marks. Each is (row, col, degrees)."""
    got = page.action()
    check(got["pick"], *pick)
    check(got["place"], *place)


def check(got, row, col, degrees):
    """A printed pose lies within half a cell and 3 degrees of where it was marked."""
    x, y = X_MIN + (col + 0.5) * CELL, Y_MAX - (row + 0.5) * CELL
    turn = (math.degrees(got["yaw"]) - degrees + 180) % 360 - 180
    assert abs(got["x"] - x) <= CELL / 2 and abs(got["y"] - y) <= CELL / 2 and abs(turn) <= 3


def mark_and_keep(page):
    assert page.action() == "the pick is not marked yet: click where the tool shall pick"
    page.wait_for_hint("Click where the tool shall pick; drag to turn it.")
    page.press(70, 20, 40)
    assert page.action() == "the place is not marked yet: click where the tool shall place"
    page.wait_for_hint("Click where the tool shall place; drag to turn it.")
    page.press(100, 74, -60, way=120, kind="touch")  # ends outside the canvas
    check_marks(page, (70, 20, 40), (100, 74, -60))
    for sentence, hint in (("put it there", 'Not kept: no bowl in "put it there"'), (SENTENCE, "Kept.")):
        page.find("textarea").send_keys(Keys.CONTROL + "a")
        page.find("textarea").send_keys(sentence)
        page.find(".keep").click()
        page.wait_for_hint(hint)
    got = page.action()
    assert got["is_kept"] and got["kept"] == 1 and got["said"] == SENTENCE


def change_marks(page):
    before = page.action()
    cells = len(page.browser.find_elements(By.CSS_SELECTOR, ".jp-Cell"))
    page.press(70, 20, -150)  # a drag on the pick turns it anew
    check(page.action()["pick"], 70, 20, -150)
    page.canvas.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_UP, Keys.ARROW_UP, "q", "q", "e")
    after = page.action()
    check(after["pick"], 68, 21, -140)
    assert after["place"] == before["place"] and not after["is_kept"]
    assert len(page.browser.find_elements(By.CSS_SELECTOR, ".jp-Cell")) == cells
    page.press(20, 40, 90)  # on no mark
    page.press(-3, 20, 90)  # above the map
    assert page.action() == after
    page.undo_both()
    assert page.action() == "the pick is not marked yet: click where the tool shall pick"
    page.canvas.send_keys(Keys.ENTER, Keys.ARROW_LEFT, "]", Keys.ENTER, Keys.ARROW_DOWN)
    check_marks(page, (79.5, 38.5, -10), (80.5, 39.5, 0))
    page.undo_both()
    page.press(1, 1)
    page.press(158, 78, 180)
    check_marks(page, (1, 1, 0), (158, 78, 180))


def use_small_page(page):
    """A page that shows the canvas at half its size."""
    page.browser.execute_script("arguments[0].parentElement.style.width = '160px'", page.canvas)
    page.undo_both()
    page.press(40, 10, 135, pixels=PIXELS / 2)
    page.press(120, 60, -90, pixels=PIXELS / 2)
    check_marks(page, (40, 10, 135), (120, 60, -90))


def main():
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder, port = Path(name), free_port()
        lab = start_lab(folder, port)
        try:
            with start_browser(folder) as browser:
                page = open_notebook(browser, port)
                for part in (mark_and_keep, change_marks, use_small_page):
                    part(page)
        finally:
            lab.terminate()
            lab.wait(30)
    print("all marks were read back")


def open_notebook(browser, port, kind=Page):
    """The page of the notebook after its first two cells."""
    page = kind(browser)
    for _ in range(100):
        with socket.socket() as one:
            if one.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.5)
    browser.get(f"http://127.0.0.1:{port}/lab/tree/mark.ipynb?reset")
    page.wait(lambda b: b.execute_script(IS_READY))
    browser.execute_script("window.jupyterapp.shell.collapseLeft()")
    page.run_cell(0)
    page.run_cell(1)
    page.wait(lambda b: b.find_elements(By.CSS_SELECTOR, f"{page.prefix} canvas"))
    time.sleep(1)
    return page


if __name__ == "__main__":
    main()
