"""Drives the page of `modulo view` in Debian's Chromium, over a replay of the sample bag.

    apt-get install chromium && pip install playwright==1.56.0
    python3 tests/peers/view.py target/debug/modulo [PICTURE.png]

Exit code 1 when the page shows no frame, a control does not reach its node, the console has an error, the page asks for
anything outside of its origin, or a script without the token can connect. PICTURE gets a screenshot.
"""

import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

from replay import address, check, viewer

PATIENCE_MS = 60_000

# Mean code of the canvas of a topic: 0 as long as nothing was drawn.
MEAN = """(topic) => {
    const figure = [...document.querySelectorAll("figure")].find((f) => f.querySelector("strong").textContent === topic);
    if (!figure) return 0;
    const canvas = figure.querySelector("canvas");
    const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    return data.reduce((sum, code, index) => sum + (index % 4 === 3 ? 0 : code), 0) / data.length;
}"""
CAPTION = """(topic) => [...document.querySelectorAll("figure")].find((f) => f.querySelector("strong").textContent === topic)
    ?.querySelector("span").textContent ?? ''"""
WITHOUT_TOKEN = """() => new Promise((done) => {
    const socket = new WebSocket(`ws://${location.host}/socket?token=0123456789abcdef`);
    socket.onopen = () => done("opened");
    socket.onerror = () => done("refused");
})"""


def wait(page, script, argument):
    page.wait_for_function(script, arg=argument, timeout=PATIENCE_MS)


class Relay:
    """Stands between the page and the viewer, so that a connection can end with a question on its way."""

    def __init__(self, page):
        self.sockets, self.deaf = [], False
        page.route_web_socket("**/socket*", self.open)

    def open(self, socket):
        server = socket.connect_to_server()
        self.sockets.append(socket)
        socket.on_message(lambda message: None if self.deaf else server.send(message))

    def lose(self, page, ask):
        """Calls `ask`, whose message does not arrive, and waits for the next connection."""
        self.deaf, before = True, len(self.sockets)
        ask()
        page.wait_for_timeout(500)
        self.deaf = False
        self.sockets[-1].close()
        while len(self.sockets) == before:
            page.wait_for_timeout(100)


def drive(page, address, picture):
    errors, places = [], set()
    relay = Relay(page)
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda why: errors.append(str(why)))
    page.on("request", lambda request: places.add(request.url.split("/")[2]))
    page.goto(address)
    for topic in ["/modulo", "/recovered"]:
        wait(page, f"(topic) => ({MEAN})(topic) > 5", topic)
        check(True, f"the page shows {topic}")
    wait(page, f"(topic) => /[1-9][0-9]* boxes/.test(({CAPTION})(topic))", "/recovered")
    check(True, "boxes are drawn on /recovered")

    page.select_option("#input", "modulo")
    wait(page, f"(topic) => /boxes/.test(({CAPTION})(topic))", "/modulo")
    read = subprocess.run([MODULO, "param", "get", "/detector", "input"], capture_output=True, text=True, check=True)
    check("modulo" in read.stdout, "the switch changes the input of the detector, and the boxes follow")
    page.select_option("#input", "recovered")
    wait(page, f"(topic) => /boxes/.test(({CAPTION})(topic))", "/recovered")
    wait(page, f"(topic) => !/boxes/.test(({CAPTION})(topic))", "/modulo")
    check(True, "no boxes are drawn on the stream that the detector has left")

    box = page.locator("figure canvas").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    wait(page, "() => document.querySelectorAll('#pixel tbody tr').length >= 2", None)
    check(True, "the pixel under the pointer is shown in each stream")

    relay.lose(page, lambda: page.mouse.move(box["x"] + 3, box["y"] + 3))
    wait(page, f"(topic) => ({MEAN})(topic) > 5", "/recovered")
    page.evaluate("() => document.querySelector('#pixel tbody').replaceChildren()")
    page.mouse.move(box["x"] + box["width"] / 3, box["y"] + box["height"] / 3)
    wait(page, "() => document.querySelectorAll('#pixel tbody tr').length >= 2", None)
    check(True, "the pixel is shown again after a connection that was lost with a question on its way")

    if picture:
        page.screenshot(path=picture, clip={"x": 0, "y": 0, "width": 1400, "height": 568})
    page.click("#toggle")
    wait(page, "() => document.getElementById('player-state').textContent.startsWith('paused')", None)
    # What was on its way when the player paused.
    page.wait_for_timeout(1500)
    before = page.evaluate(CAPTION, "/recovered")
    page.fill("#seek", "0.5")
    page.keyboard.press("Enter")
    for _ in range(3):
        page.click("#next")
        page.wait_for_timeout(500)
    wait(page, f"(before) => ({CAPTION})('/recovered') !== before", before)
    check(True, "a paused replay seeks and plays single messages")

    check(not errors, f"no error on the console: {errors}")
    check(places == {address.split("/")[2]}, f"no request outside of the page's origin: {places}")
    # The refusal itself is an error on the console.
    check(page.evaluate(WITHOUT_TOKEN) == "refused", "a script without the token cannot connect")


def main():
    global MODULO
    MODULO, picture = str(Path(sys.argv[1]).resolve()), (sys.argv[2:] or [None])[0]
    with viewer(MODULO, "139") as process, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        drive(browser.new_page(viewport={"width": 1400, "height": 900}), address(process, "http://"), picture)
        browser.close()


if __name__ == "__main__":
    main()
