"""Drives the page of web/ in Debian's Chromium, from a file and from a host, and compares its codes with those of `modulo simulate`, its boxes
with those of `modulo eval`.

    apt-get install chromium && pip install playwright==1.56.0 pypng==0.20220715.0 axe-playwright-python==0.1.8
    web/build && python3 tests/peers/web.py target/debug/modulo target/web/index.html [FOLDER FOR SCREENSHOTS]

Exit code 1 when the page has more than 5 MB, asks for anything beside itself, has an error in the console, does not say what is wrong with a
file, lays one text over another, or breaks a rule of axe; or when a code, the share of exact counts, the trust or a box (by 0.5 px) differs
from those of the command line that it shows.
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
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

from replay import check
from view import CLASHES, PATIENCE_MS, wait

LARGEST_PAGE = 5_000_000
# The farthest that an edge of a box may lie from that of the command line, in px.
NEAR_PX = 0.5
WIDTHS = [390, 820, 1500]
# The settings of the page: alpha, sigma, noise, bits, and whether there are shaded columns.
CAMERAS = [(4, 1.4, 0, 8, True), (2, 1.4, 3, 8, False), (8, 2.0, 0, 8, True), (3, 0.3, 0, 6, False), (4, 1.4, 40, 12, True), (1, 0, 0, 8, False), (8, 0, 0, 8, False), (4, 1.4, 30, 8, False)]
# Scenes, and the cameras with which their boxes are compared.
SCENES = [("glare", (4, 1.4, 0, 8, True)), ("glare", (16, 1.4, 0, 8, True)), ("night", (8, 1.4, 2, 10, False))]
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
# Red, green and blue of the recovered image as it is shown.
SHOWN = """() => {
    const { width, height } = state.answer.images[2];
    return [...state.answer.images[2].getContext("2d").getImageData(0, 0, width, height).data].filter((_, index) => index % 4 < 3);
}"""
FOUND = "() => ['left', 'right'].every((side) => document.getElementById(`${side}-found`).textContent.includes('found'))"
BOXES = "() => [0, 2].map((stream) => state.boxes[stream].found.map(({ name, score, edges }) => [edges, score, CLASSES[name][0]]))"
SURE = 0.5


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
    if picture.name == "colour.png" and camera[3] == 8:
        check(page.evaluate(SHOWN) == codes[1], f"{picture.name}, camera {camera}: the recovered image is shown as the picture that it is")
    command = page.text_content("#command").replace("FILE", str(picture)).replace("-o out", f"-o {folder}").split()
    subprocess.run([modulo, *command[1:], "--exr"], check=True, capture_output=True)
    [row] = json.loads((folder / "results.json").read_text())
    name = folder / f"{picture.stem}_alpha{camera[0]}"
    same = [codes_of(f"{name}_{stream}.png") for stream in ["modulo", "auto"]] == codes
    exact = page.text_content("#exact")
    # The page cuts after three digits, and says 100 % of all samples only.
    agrees = exact.startswith("100 %") if row["exact_k"] == 1 else abs(float(exact.split()[0]) - 100 * row["exact_k"]) < 1e-3
    trusted = page.evaluate(TRUSTED)
    check(same and agrees and trusted == row["trusted"], f"{picture.name}, camera {camera}: {exact}, trusted {trusted}, as `modulo simulate`")
    return folder


def compare_boxes(page, modulo, camera, folder):
    """The boxes in the normal and in the recovered image of a scene are those of `modulo eval`, whose command line the page shows."""
    page.evaluate(SET, list(camera))
    settled(page, "The scene")
    wait(page, FOUND)
    shown = dict(zip(["saturated", "recovered"], page.evaluate(BOXES)))
    command = [part.strip("'") for part in page.text_content("#command").replace("-o out", f"-o {folder}").split()]
    subprocess.run([modulo, *command[1:]], check=True, capture_output=True)
    cells = [json.loads(file.read_text()) for file in (folder / "cells").glob("*.json")]
    wanted = {cell["key"]["point"]["stream"]: cell["frames"][0]["boxes"] for cell in cells}

    def is_near(one, other):
        return one[2] == other[2] and abs(one[1] - other[1]) < 0.01 and all(abs(a - b) <= NEAR_PX for a, b in zip(one[0], other[0]))

    for stream, boxes in shown.items():
        missed = [box for box in wanted[stream] if box[1] > SURE + 0.01 and not any(is_near(box, other) for other in boxes)]
        added = [box for box in boxes if not any(is_near(box, other) for other in wanted[stream])]
        check(not missed and not added, f"camera {camera}: the {len(boxes)} boxes in {stream} are those of `modulo eval`: {missed} {added}")
    check(len(shown["recovered"]) >= 5, "the detector finds objects in the recovered image")


def share(page, address):
    """A link has the settings, and what is wrong in one is left out."""
    page.goto("about:blank")
    page.goto(f"{address}#scene=tunnel&alpha=8&left=ideal&right=wrap&wipe=25&columns=32")
    settled(page, "The scene: end of a tunnel")
    page.focus("#alpha")
    page.keyboard.press("ArrowRight")
    wait(page, "() => location.hash.includes('scene=tunnel') && location.hash.includes('alpha=8.5') && location.hash.includes('right=wrap')")
    page.goto(f"{address}#scene=own&alpha=99&left=nothing")
    settled(page, "The scene: street against a low sun")
    check([page.input_value(f"#{field}") for field in ["alpha", "left"]] == ["16", "normal"], "the address has the settings of the page")


def fit_each_window(page, folder):
    for scheme in ["light", "dark"]:
        page.emulate_media(color_scheme=scheme)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_timeout(200)
            if folder:
                page.screenshot(path=f"{folder}/{scheme}_{width}.png", full_page=True)
            clashes, faults = page.evaluate(CLASHES), Axe().run(page).response["violations"]
            check(not faults, f"{width} px, {scheme}: axe finds nothing: {[(fault['id'], fault['nodes'][0]['html']) for fault in faults]}")
            check(not clashes, f"{width} px, {scheme}: no text over another one, nothing outside of the page: {clashes[:5]}")


def drive(page, address, modulo, folder):
    troubles, asked = [], []
    page.on("console", lambda message: troubles.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda why: troubles.append(str(why)))
    page.on("request", lambda request: asked.append(request.url.split(":")[0]))
    page.goto(address)
    settled(page, "The scene")
    check(page.evaluate(TRUSTED) and page.text_content("#exact").startswith("100 %"), f"the scene is exact and trusted at {address.split(':')[0]}")
    with tempfile.TemporaryDirectory() as scratch:
        for scene, camera in SCENES:
            page.select_option("#scene", scene)
            compare_boxes(page, modulo, camera, Path(tempfile.mkdtemp(dir=scratch)))
        found = [*pictures(Path(scratch)), Path(scratch) / "sample.jpg"]
        found[-1].write_bytes(base64.b64decode(page.evaluate(JPEG)))
        for index, picture in enumerate(found):
            page.set_input_files("#file", picture)
            settled(page, picture.name)
            for camera in CAMERAS if index == 0 else CAMERAS[:2]:
                folder_of = compare(page, modulo, picture, camera, Path(tempfile.mkdtemp(dir=scratch)))
            # The recovered radiance of an HDR picture is an OpenEXR file.
            found.extend(folder_of.glob("*.exr") if picture.suffix == ".hdr" else [])
        check(picture.suffix == ".exr", "an OpenEXR file is read")
    page.evaluate(DROP)
    settled(page, "This file: is none of the images that are read, which are PNG, JPEG")
    page.select_option("#scene", "night")
    settled(page, "The scene: street at night")
    check(True, "the page says what is wrong with a file, and goes on")
    share(page, address)
    fit_each_window(page, folder)
    check(not troubles and set(asked) <= {"file", "http", "blob", "data"} and sum(kind in ("file", "http") for kind in asked) == 2, f"nothing but the page is asked for: {troubles} {asked}")


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
        settled(hosted, "The scene")
        check(True, "the page runs from a host")
        browser.close()
        server.shutdown()


if __name__ == "__main__":
    main()
