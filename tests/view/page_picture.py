# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Makes the picture of the page in the README: `make picture`, which needs Chromium.

python tests/view/page_picture.py RECORDING SECOND PICTURE
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from browser import Browser, served
from PIL import Image

SIZE = (1440, 940)
# A vehicle rather than a pedestrian.
FASTER_THAN_M_S = 4.0
CLOCK = "document.querySelector('#clock').textContent"
SPEED = "parseFloat(document.querySelector('#selection dd')?.textContent)"
HAS_REASONS = "document.querySelector('#selection li') !== null"


def main() -> None:
    """Pauses at a second, and selects the nearest vehicle that moves."""
    recording, second, picture = sys.argv[1], float(sys.argv[2]), sys.argv[3]
    with (
        tempfile.TemporaryDirectory() as folder,
        served(recording) as url,
        Browser(url, Path(folder), SIZE) as browser,
    ):
        browser.until("document.body.dataset.stamp")
        browser.click("#play")
        browser.value(
            f"const bar = document.querySelector('#time'); bar.value = {second}; bar.onchange()"
        )
        browser.until(f"Math.abs(parseFloat({CLOCK}) - {second}) < 0.2")
        for _ in range(30):
            browser.press("n")
            if browser.value(SPEED) is None or browser.value(SPEED) > FASTER_THAN_M_S:
                break
        browser.until(HAS_REASONS)
        Image.fromarray(browser.picture()).save(picture, quality=80, method=6)


if __name__ == "__main__":
    main()
