"""Open the built book in a real browser that reaches no network: pages fit, sliders move their pictures.

It needs the book (`make book`) and what mark_action.py needs::

    /tmp/browser/bin/python tests/browser/book.py [FOLDER FOR PICTURES OF THE PAGES]

pytest does not collect it.
"""

import json
import sys
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.support.wait import WebDriverWait

BOOK = Path(__file__).resolve().parents[2] / "build" / "book"
LAPTOP, TELEPHONE = 1280, 390
"""Widths of the page, in pixels. On a telephone long lines of code scroll."""
PICTURES_OF = ("docs/index", "notebooks/04_steerable_kernels", "notebooks/07_crop_conditioned_place")
OVERFLOWS = """
return document.documentElement.scrollWidth > document.documentElement.clientWidth + 1"""
LONG_LINES = """
return [...document.querySelectorAll('.bd-article .cell_input pre')]
  .filter((code) => code.offsetParent && code.scrollWidth > code.clientWidth + 1).length"""
FRAME = """
const [place, number] = arguments;
const slider = place.querySelector('input');
slider.value = number;
slider.dispatchEvent(new Event('input'));"""
IS_SHOWN = "return arguments[0].textContent.includes(` frame ${arguments[1] + 1} of `)"
DRAWN = """
const canvases = [...arguments[0].closest('.cell_output').querySelectorAll('canvas')];
return canvases.at(-1).toDataURL()"""


def start_browser(width):
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for flag in ("headless=new", "no-sandbox", "disable-gpu", "disable-sync", "host-resolver-rules=MAP * ~NOTFOUND"):
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService("/usr/bin/chromedriver"))
    size = {"width": width, "height": 1400, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    return browser


def asked_of_the_network(browser):
    """The addresses that the page asked for outside this machine's disk."""
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [message["params"] for message in messages if message["method"] == "Network.requestWillBeSent"]
    return [each["request"]["url"] for each in sent if each["request"]["url"].startswith("http")]


def check_sliders(browser, page):
    """Each slider of the page shows different frames. Returns how many there are."""
    count = page.read_text().count('class="gem-slider"')
    WebDriverWait(browser, 60).until(lambda _: len(browser.find_elements(By.CSS_SELECTOR, ".gem-slider")) == count)
    places = browser.find_elements(By.CSS_SELECTOR, ".gem-slider")
    for place in places:
        WebDriverWait(browser, 60).until(lambda _, place=place: place.find_elements(By.CSS_SELECTOR, "input"))
        last = int(place.find_element(By.CSS_SELECTOR, "input").get_attribute("max"))
        drawn = set()
        for number in (0, last // 2, last):
            browser.execute_script(FRAME, place, number)
            WebDriverWait(browser, 60).until(
                lambda _, place=place, number=number: browser.execute_script(IS_SHOWN, place, number)
            )
            drawn.add(browser.execute_script(DRAWN, place))
        assert len(drawn) > 1, browser.current_url
    return count


def main(folder):
    pages = [BOOK / "docs" / "index.html", *sorted((BOOK / "notebooks").glob("*.html"))]
    for width in (LAPTOP, TELEPHONE):
        with start_browser(width) as browser:
            for page in pages:
                browser.get(page.as_uri())
                name = page.relative_to(BOOK).with_suffix("").as_posix()
                if folder is not None and name in PICTURES_OF:
                    browser.save_screenshot(str(folder / f"{page.stem}-{width}.png"))
                sliders, long_lines = check_sliders(browser, page), browser.execute_script(LONG_LINES)
                print(f"{width} {name}: {sliders} sliders, {long_lines} pieces of code with long lines", flush=True)
                assert not browser.execute_script(OVERFLOWS), f"{name} is wider than {width} pixels"
                assert width != LAPTOP or not long_lines, f"{name}: code runs out of its box at {width}"
                assert not asked_of_the_network(browser), name


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
