# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Makes the pictures of the page in the README: `make picture`, which needs Chromium.

python tests/view/page_pictures.py RECORDING SECOND FOLDER
"""

import sys
import tempfile
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
    """Pauses at a second, and selects the nearest vehicle that moves; then steps on."""
    recording, second, folder = sys.argv[1], float(sys.argv[2]), Path(sys.argv[3])
    with (
        tempfile.TemporaryDirectory() as profile,
        served(recording) as url,
        Browser(url, Path(profile), SIZE) as browser,
    ):
        browser.show_as(*SIZE, "dark")
        browser.until(STAMP)
        browser.click("#play")
        seek(browser, second)
        for _ in range(30):
            browser.press("n")
            if browser.value(SPEED) is None or browser.value(SPEED) > FASTER_THAN_M_S:
                break
        browser.until(HAS_REASONS)
        Image.fromarray(browser.picture()).save(folder / "page.webp", quality=80, method=6)
        browser.click("#forget")
        seek(browser, 1.0)
        first, *others = (frame_of(browser) for _ in range(NUM_FRAMES))
        options = {"duration": INTERVAL_MS, "loop": 0, "quality": 45, "method": 4}
        first.save(folder / "street.webp", save_all=True, append_images=others, **options)


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
