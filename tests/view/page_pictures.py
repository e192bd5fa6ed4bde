# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Makes the pictures of the page in the README: `make picture`, which needs Chromium.

python tests/view/page_pictures.py RECORDING SECOND FOLDER [REAL SECOND]

REAL is a recording of a real drive.
"""

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from browser import Browser, served
from PIL import Image

SIZE = (1440, 940)
NUM_FRAMES, INTERVAL_MS = 40, 100
# A vehicle rather than a pedestrian.
FASTER_THAN_M_S = 4.0
CLOCK = "document.querySelector('#clock').textContent"
STAMP = "document.body.dataset.stamp"
SPEED = "parseFloat(document.querySelector('#selection dd')?.textContent)"
HAS_REASONS = "document.querySelector('#selection li') !== null"
BOX = "(({x, y, width, height}) => [x, y, x + width, y + height])"
STREET = f"{BOX}(document.querySelector('#points').getBoundingClientRect())"


def main() -> None:
    """Draws the page and the street of a recording, and a real drive if one is named."""
    recording, second, folder = sys.argv[1], float(sys.argv[2]), Path(sys.argv[3])
    with paused(recording, second) as browser:
        draw_page(browser, folder / "page.webp")
        draw_street(browser, folder / "street.webp")
    if sys.argv[4:]:
        with paused(sys.argv[4], float(sys.argv[5])) as browser:
            frame_of(browser).save(folder / "drive.webp", quality=80, method=6)


@contextmanager
def paused(recording: str, second: float) -> Iterator[Browser]:
    """The page of a recording at a second, dark."""
    with (
        tempfile.TemporaryDirectory() as profile,
        served(recording) as url,
        Browser(url, Path(profile), SIZE) as browser,
    ):
        browser.show_as(*SIZE, "dark")
        browser.until(STAMP)
        browser.click("#play")
        seek(browser, second)
        yield browser


def draw_page(browser: Browser, file: Path) -> None:
    """With the nearest vehicle that moves selected."""
    for _ in range(30):
        browser.press("n")
        if browser.value(SPEED) is None or browser.value(SPEED) > FASTER_THAN_M_S:
            break
    browser.until(HAS_REASONS)
    Image.fromarray(browser.picture()).save(file, quality=80, method=6)
    browser.click("#forget")


def draw_street(browser: Browser, file: Path) -> None:
    """An animation."""
    seek(browser, 1.0)
    first, *others = (frame_of(browser) for _ in range(NUM_FRAMES))
    options = {"duration": INTERVAL_MS, "loop": 0, "quality": 45, "method": 4}
    first.save(file, save_all=True, append_images=others, **options)


def seek(browser: Browser, second: float) -> None:
    browser.seek(second)
    browser.until(f"Math.abs(parseFloat({CLOCK}) - {second}) < 0.2")


def frame_of(browser: Browser) -> Image.Image:
    """The street on the page, which then goes on to the next sweep."""
    street = Image.fromarray(browser.picture()).crop(browser.value(STREET))
    stamp = browser.value(STAMP)
    browser.click("#next")
    browser.until(f"{STAMP} !== '{stamp}'")
    return street.resize((880, round(880 * street.height / street.width)))


if __name__ == "__main__":
    main()
