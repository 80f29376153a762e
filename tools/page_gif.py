"""Records the page of `modulo demo` while its wipe moves, as docs/images/page.gif.

Usage: python tools/page_gif.py BINARY. Needs playwright, Chromium and ffmpeg.
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

OUT = Path(__file__).parents[1] / "docs/images/page.gif"
# Positions of the wipe, in percent, there and back.
WIPES = [*range(85, 14, -5), *range(15, 86, 5)]


def main(binary: str) -> None:
    # No desktop, no browser of its own.
    hidden = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    demo = subprocess.Popen([binary, "demo", "--port", "0"], stdout=subprocess.PIPE, text=True, env=hidden)
    address = next(found[0] for line in demo.stdout if (found := re.search(r"http://\S+", line)))
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 900, "height": 800}, color_scheme="dark")
        page.goto(address)
        page.wait_for_timeout(10_000)
        for number, wipe in enumerate(WIPES):
            page.locator("#wipe").evaluate(f"(wipe) => {{ wipe.value = {wipe}; wipe.oninput({{ target: wipe }}); }}")
            page.wait_for_timeout(150)
            page.locator("#stage .large").screenshot(path=f"{folder}/{number:03}.png")
        browser.close()
        palette = "scale=720:-1:flags=lanczos,split[a][b];[a]palettegen=max_colors=128[p];[b][p]paletteuse=dither=none"
        ffmpeg = ["ffmpeg", "-v", "error", "-y", "-framerate", "6", "-i", f"{folder}/%03d.png", "-vf", palette, str(OUT)]
        subprocess.run(ffmpeg, check=True)
    demo.send_signal(signal.SIGINT)
    demo.wait()


main(sys.argv[1])
