"""Open `gem-lite app` in a real browser: a sentence, an act, a refusal, an upload, a reset, two visitors, a telephone.

It needs gradio (docs/app.txt), selenium, chromium and its driver::

    /tmp/app/bin/python tests/browser/page.py [FOLDER FOR PICTURES OF THE PAGE]

pytest does not collect it.
"""

import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.common.by import By
from selenium.webdriver.support.wait import WebDriverWait

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "data" / "foreign-scenes" / "workbench"
TELEPHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}


def start_browser():
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    rules = "host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"  # no other machine is reached
    for flag in ("headless=new", "no-sandbox", "disable-gpu", "disable-sync", "window-size=1280,1100", rules):
        options.add_argument(f"--{flag}")
    return webdriver.Chrome(options=options, service=webdriver.ChromeService("/usr/bin/chromedriver"))


class Visitor:
    def __init__(self, address):
        self.browser = start_browser()
        self.browser.get(address)
        self.wait(lambda: self.browser.find_elements(By.CSS_SELECTOR, "#lay"))

    def wait(self, until, seconds=180):
        # gradio may draw a part of the page anew while it is read.
        waiting = WebDriverWait(self.browser, seconds, ignored_exceptions=[StaleElementReferenceException])
        return waiting.until(lambda _: until())

    def answer(self):
        return self.browser.find_element(By.CSS_SELECTOR, "#answer textarea").get_attribute("value")

    def press(self, name, begins):
        """Press a button, and wait for an answer that begins so."""
        button = self.browser.find_element(By.CSS_SELECTOR, f"#{name}")
        self.browser.execute_script("arguments[0].click()", button)
        self.wait(lambda: self.answer().startswith(begins))
        return self.answer()

    def say(self, sentence, begins):
        box = self.browser.find_element(By.CSS_SELECTOR, "#sentence textarea, #sentence input")
        box.clear()
        box.send_keys(sentence)
        return self.press("ask", begins)

    def picture(self):
        found = self.browser.find_elements(By.CSS_SELECTOR, "#picture img")
        return found[0].get_attribute("src") if found else ""

    def show_on_telephone(self):
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", TELEPHONE)
        time.sleep(1)
        widths = "return [document.documentElement.scrollWidth, arguments[0].getBoundingClientRect().width]"
        page, picture = self.browser.execute_script(widths, self.browser.find_element(By.CSS_SELECTOR, "#picture img"))
        assert page <= TELEPHONE["width"], f"nothing is wider than the screen, got {page} pixels"
        assert picture > 0.8 * TELEPHONE["width"], f"the picture is as wide as the screen, got {picture} pixels"

    def upload(self, files):
        tab = next(tab for tab in self.browser.find_elements(By.CSS_SELECTOR, "button[role=tab]") if "Your" in tab.text)
        tab.click()
        chooser = self.wait(lambda: self.browser.find_elements(By.CSS_SELECTOR, "input[type=file]"))[0]
        chooser.send_keys("\n".join(map(str, files)))
        time.sleep(3)


def main():
    pictures = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    temporary = Path(tempfile.mkdtemp())
    command = [sys.executable, "-m", "gem_lite.cli", "app", "--port", str(port)]
    environment = {"GRADIO_TEMP_DIR": str(temporary), "PATH": "/usr/bin:/bin", "HOME": str(temporary)}
    server = subprocess.Popen(command, cwd=ROOT, env=environment)
    try:
        for _ in range(240):
            with socket.socket() as asking:
                if asking.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(1)
        visitor, other = (Visitor(f"http://127.0.0.1:{port}") for _ in range(2))
        sentence = visitor.press("lay", "The task says").split('"')[1]
        laid = visitor.wait(visitor.picture)
        print(visitor.say(sentence, "Understood"))
        visitor.wait(lambda: visitor.picture() not in ("", laid))
        if pictures:
            visitor.browser.save_screenshot(str(pictures / "asked.png"))
        assert other.answer() == "" and not other.picture(), "another visitor has a table of his own"
        print(visitor.press("act", "Outcome"))
        assert "one choice is carried out once" in visitor.press("act", "Not possible")
        print(visitor.say("put the banana in the brown box", "Refused"))
        print(visitor.say("dance", "Not possible"))
        assert "lay a table first" in other.say(sentence, "Not possible")
        other.upload(sorted(path for path in SCENE.iterdir() if path.name != "truth.json"))
        print(other.press("upload", "Your table"))
        print(other.say("put the red block in the blue bowl", "Understood"))
        if pictures:
            other.browser.save_screenshot(str(pictures / "uploaded.png"))
        other.show_on_telephone()
        if pictures:
            other.browser.save_screenshot(str(pictures / "telephone.png"))
        left = [path for path in temporary.rglob("*") if path.name in {file.name for file in SCENE.iterdir()}]
        assert not left, f"uploads are not kept: {left}"
        visitor.browser.execute_script("arguments[0].click()", visitor.browser.find_element(By.CSS_SELECTOR, "#reset"))
        visitor.wait(lambda: not visitor.picture() and visitor.answer() == "")
        assert "lay a table first" in visitor.say(sentence, "Not possible")
        for each in (visitor, other):
            each.browser.quit()
        print("a sentence, an act, a refusal, an upload and a reset: as they should be")
    finally:
        server.kill()
        server.wait()


main()
