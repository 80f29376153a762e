"""Drives the page of web/ in Debian's Chromium, from a file and from a host, and compares its codes with those of `modulo simulate`.

    apt-get install chromium && pip install playwright==1.56.0 pypng==0.20220715.0
    web/build && python3 tests/peers/web.py target/debug/modulo target/web/index.html [FOLDER FOR SCREENSHOTS]

Exit code 1 when the page has 1 MB or more, asks for anything beside itself, has an error in the console, does not say what is wrong with a
file, lays one text over another; or when a code, the share of exact counts or the trust differs from those of `modulo simulate`.
"""

import base64
import http.server
import json
import math
import shutil
import subprocess
import sys
import tempfile
import threading
from functools import partial
from pathlib import Path

import png
from playwright.sync_api import sync_playwright

from replay import check
from view import CLASHES, PATIENCE_MS, wait

LARGEST_PAGE = 1_000_000
WIDTHS = [390, 820, 1500]
# The settings of the page: alpha, sigma, noise, bits, and whether there are shaded columns.
CAMERAS = [(4, 1.4, 0, 8, True), (2, 1.4, 3, 8, False), (8, 2.0, 0, 8, True), (3, 0.3, 0, 6, False), (4, 1.4, 40, 12, True), (1, 0, 0, 8, False), (8, 0, 0, 8, False), (4, 1.4, 30, 8, False)]
TRUSTED = "() => document.getElementById('trust').className === 'good'"
SET = """([alpha, sigma, noise, bits, columns]) => {
    for (const [id, value] of Object.entries({ alpha, sigma, noise, bits })) document.getElementById(id).value = value;
    document.getElementById("columns").checked = columns;
    document.getElementById("settings").dispatchEvent(new Event("input"));
}"""
DROP = """() => {
    const transfer = new DataTransfer();
    transfer.items.add(new File(["no picture"], "notes.png"));
    document.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, cancelable: true }));
}"""
# What the page shows on the left, as a JPEG.
JPEG = "() => document.getElementById('left-canvas').toDataURL('image/jpeg').split(',')[1]"
CODES = "async () => (await readCodes()).map((codes) => [...codes])"


def pictures(folder):
    """Writes small pictures with a bright sun, soft and hard edges; returns their paths."""

    def light(row, column, channel):
        sun = math.exp(-((row - 30 - 4 * channel) ** 2 + (column - 70) ** 2) / 900)
        return min(1, 0.1 + 0.002 * row + 0.9 * sun + (0.3 if 20 < column < 30 and row > 40 else 0))

    def rows(channels, most):
        return [[round(most * light(row, column, channel)) for column in range(120) for channel in range(channels)] for row in range(80)]

    for name, channels, depth in [("colour", 3, 8), ("grey", 1, 8), ("deep", 3, 16)]:
        writer = png.Writer(120, 80, greyscale=channels == 1, bitdepth=depth)
        with (folder / f"{name}.png").open("wb") as file:
            writer.write(file, rows(channels, 2**depth - 1))
    pixels = [bytes([*(int(200 * light(row, column, channel)) for channel in range(3)), 130]) for row in range(80) for column in range(120)]
    (folder / "sky.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 80 +X 120\n" + b"".join(pixels))
    return [folder / name for name in ["colour.png", "grey.png", "deep.png", "sky.hdr"]]


def codes_of(path):
    _, _, rows, about = png.Reader(str(path)).read()
    samples = [sample for row in rows for sample in row]
    return [byte for sample in samples for byte in sample.to_bytes(2, "little")] if about["bitdepth"] == 16 else samples


def settled(page, part):
    wait(page, "(part) => document.getElementById('status').textContent.includes(part)", part)


def compare(page, modulo, picture, camera, folder):
    """The codes, the exact share and the trust are those of `modulo simulate`, whose command line the page shows."""
    page.evaluate(SET, list(camera))
    codes = page.evaluate(CODES)
    settled(page, picture.name)
    command = page.text_content("#command").replace("FILE", str(picture)).replace("-o out", f"-o {folder}").split()
    subprocess.run([modulo, *command[1:]], check=True, capture_output=True)
    [row] = json.loads((folder / "results.json").read_text())
    name = folder / f"{picture.stem}_alpha{camera[0]}"
    same = [codes_of(f"{name}_{stream}.png") for stream in ["modulo", "auto"]] == codes
    exact = page.text_content("#exact")
    # The page cuts after three digits, and says 100 % of all samples only.
    agrees = exact.startswith("100 %") if row["exact_k"] == 1 else abs(float(exact.split()[0]) - 100 * row["exact_k"]) < 1e-3
    trusted = page.evaluate(TRUSTED)
    check(same and agrees and trusted == row["trusted"], f"{picture.name}, camera {camera}: {exact}, trusted {trusted}, as `modulo simulate`")


def fit_each_window(page, folder):
    for scheme in ["light", "dark"]:
        page.emulate_media(color_scheme=scheme)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_timeout(200)
            if folder:
                page.screenshot(path=f"{folder}/{scheme}_{width}.png", full_page=True)
            clashes = page.evaluate(CLASHES)
            check(not clashes, f"{width} px, {scheme}: no text over another one, nothing outside of the page: {clashes[:5]}")


def drive(page, address, modulo, folder):
    troubles, asked = [], []
    page.on("console", lambda message: troubles.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda why: troubles.append(str(why)))
    page.on("request", lambda request: asked.append(request.url.split(":")[0]))
    page.goto(address)
    settled(page, "The sample")
    check(page.evaluate(TRUSTED) and page.text_content("#exact").startswith("100 %"), f"the sample is exact and trusted at {address.split(':')[0]}")
    with tempfile.TemporaryDirectory() as scratch:
        found = [*pictures(Path(scratch)), Path(scratch) / "sample.jpg"]
        found[-1].write_bytes(base64.b64decode(page.evaluate(JPEG)))
        for index, picture in enumerate(found):
            page.set_input_files("#file", picture)
            settled(page, picture.name)
            for camera in CAMERAS if index == 0 else CAMERAS[:2]:
                compare(page, modulo, picture, camera, Path(tempfile.mkdtemp(dir=scratch)))
    page.evaluate(DROP)
    settled(page, "This file: ")
    page.click("#sample")
    settled(page, "The sample")
    check(True, "the page says what is wrong with a file, and goes on")
    fit_each_window(page, folder)
    check(not troubles and set(asked) <= {"file", "http", "blob", "data"} and sum(kind in ("file", "http") for kind in asked) == 1, f"nothing but the page is asked for: {troubles} {asked}")


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        """Prints nothing for a request."""


def main():
    modulo, built = (str(Path(path).resolve()) for path in sys.argv[1:3])
    folder = (sys.argv[3:] or [None])[0]
    size = Path(built).stat().st_size
    check(size < LARGEST_PAGE, f"the page has {size // 1000} kB")
    handler = partial(Quiet, directory=str(Path(built).parent))
    with sync_playwright() as playwright, http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        new_page = partial(browser.new_page, viewport={"width": 1500, "height": 1000})
        drive(new_page(), f"file://{built}", modulo, folder)
        hosted = new_page()
        hosted.goto(f"http://127.0.0.1:{server.server_port}/index.html")
        settled(hosted, "The sample")
        check(True, "the page runs from a host")
        browser.close()
        server.shutdown()


if __name__ == "__main__":
    main()
