"""Drives the page of `modulo view` in Debian's Chromium, over a replay of the sample bag, two cameras, and six detectors on a busy machine.

    apt-get install chromium && pip install playwright==1.56.0 axe-playwright-python==0.1.8
    python3 tests/peers/view.py target/debug/modulo

Exit code 1 when the page shows no frame, shows images of two moments of a camera at once, lets one camera wait for another one, lays
one text over another, draws a line between two nodes that have none, shows a frame without its boxes, loses the open tab, changes the colour of a node, has a control that the keyboard does not reach, breaks a rule of axe, shows another exposure with boxes of the original one, or does not go on after a loss;
when a control does not reach its node, the console has an error, the page asks for anything outside of its origin, or a script without the token can connect.
"""

import contextlib
import json
import os
import re
import shutil
import signal
import socket
import socketserver
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

from replay import BAG, ROOT, address, check, viewer

PATIENCE_MS = 60_000
WIDTHS = {390: 844, 820: 1180, 1500: 1000, 2560: 1440}
# The tabs, each with a part of its content.
TABS = {"look": "#topic-list input", "time": ".plots canvas", "nodes": "#graph article", "parameters": "details.node"}

# Mean code of the image of a topic: 0 as long as nothing was drawn.
MEAN = """(topic) => {
    const figure = [...document.querySelectorAll(".large figure")].find((f) => f.querySelector("strong").textContent === topic);
    const canvas = figure?.querySelector("canvas.image");
    if (!canvas || canvas.hidden) return 0;
    const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    return data.reduce((sum, code, index) => sum + (index % 4 === 3 ? 0 : code), 0) / data.length;
}"""
CAPTION = """(topic) => [...document.querySelectorAll(".large figure")].find((f) => f.querySelector("strong").textContent === topic)
    ?.querySelector("figcaption span").textContent ?? ''"""
STAMP = """(topic) => [...document.querySelectorAll(".large figure")].find((f) => f.querySelector("strong").textContent === topic)
    ?.querySelector(".picture").dataset.stamps ?? ''"""
# Each shown stream with the number of detectors that have answered its frame, and its trust.
LOOK = """() => [...document.querySelectorAll(".large figure")].map((figure) => {
    const { stamps, answers, trust } = figure.querySelector(".picture").dataset;
    return [figure.querySelector("strong").textContent, stamps, answers, trust, figure.innerText];
})"""
# For each line of the graph the cards whose border it touches, in the order in which it comes to them.
EDGES = """() => [...document.querySelectorAll("#graph path")].map((path) => {
    const origin = path.ownerSVGElement.getBoundingClientRect();
    const touched = [];
    for (let at = 0; at <= path.getTotalLength(); at += 1) {
        const point = path.getPointAtLength(at);
        const [x, y] = [point.x + origin.left, point.y + origin.top];
        for (const card of document.querySelectorAll("article")) {
            const { left, right, top, bottom } = card.getBoundingClientRect();
            const name = card.querySelector("h3 span").textContent;
            if (x > left - 2.5 && x < right + 2.5 && y > top - 2.5 && y < bottom + 2.5 && touched.at(-1) !== name) touched.push(name);
        }
    }
    return touched.join(" -> ");
}).sort()"""
COLOURS = """() => Object.fromEntries([...document.querySelectorAll("article h3")].map((head) =>
    [head.querySelector("span").textContent, getComputedStyle(head.querySelector(".mark")).backgroundColor]))"""
# What the table of the pixel says of a stream: its codes, and what is below them.
PIXEL = """(topic) => [...document.querySelectorAll("#pixel tr")].filter((row) => row.querySelector("th").textContent === topic)
    .map((row) => [...row.querySelectorAll("td")].map((cell) => [cell.firstChild.textContent, cell.querySelector("small").textContent]))[0] ?? []"""
# The score of an image with a box where the ideal image has two, and where it has labels; that of the ideal image itself.
SCORES = """async () => {
    const { scoreOf } = await import("/marks.js");
    const boxes = (...places) => [["/boxes", places.map((at) => ({ edges: [at, 0, at + 10, 10], class: "car", score: 0.9 }))]];
    const [image, ideal] = [{ boxes: boxes(0, 50), truth: [] }, { boxes: boxes(1, 20), truth: [] }];
    return [image, { ...image, truth: boxes(50)[0][1] }, ideal].map((image) => scoreOf(image, ideal, 0.5));
}"""
WITHOUT_TOKEN = """() => new Promise((done) => {
    const socket = new WebSocket(`ws://${location.host}/socket?token=0123456789abcdef`);
    socket.onopen = () => done("opened");
    socket.onerror = () => done("refused");
})"""
# Looks at the stamps of all shown images whenever one of them changes, before the page is painted.
MOMENTS = """() => {
    window.moments = [];
    const look = () => {
        const stamps = [...document.querySelectorAll(".picture")].flatMap(({ dataset }) => dataset.stamps.split(" ")).filter((stamp) => stamp);
        window.moments.push([...new Set(stamps)]);
    };
    new MutationObserver(look).observe(document.getElementById("stage"), { subtree: true, attributes: true, attributeFilter: ["data-stamps"] });
}"""
# The texts and the controls that lie over each other or outside of the page.
CLASHES = """() => {
    const boxes = [];
    const clipped = (rect, element) => {
        let { left, top, right, bottom } = rect;
        for (let at = element; at && at !== document.body; at = at.parentElement) {
            if (getComputedStyle(at).overflowX !== "hidden") continue;
            const area = at.getBoundingClientRect();
            [left, top, right, bottom] = [Math.max(left, area.left), Math.max(top, area.top), Math.min(right, area.right), Math.min(bottom, area.bottom)];
        }
        return { left, top, right, bottom };
    };
    const add = (owner, text, rects) => rects.map((rect) => clipped(rect, owner)).filter((r) => r.right - r.left > 1 && r.bottom - r.top > 1)
        .forEach((rect) => boxes.push({ owner, text: text.trim().slice(0, 60), rect }));
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
        const parent = node.parentElement;
        if (!node.textContent.trim() || parent.closest("script, option, svg") || !parent.checkVisibility()) continue;
        const range = document.createRange();
        range.selectNodeContents(node);
        add(parent, node.textContent, [...range.getClientRects()]);
    }
    for (const control of document.querySelectorAll("input, select, button")) {
        if (control.checkVisibility()) add(control, `<${control.id || control.type || control.tagName}>`, [control.getBoundingClientRect()]);
    }
    const found = boxes.filter(({ rect }) => rect.left < -1 || rect.right > innerWidth + 1).map(({ text }) => `outside: ${text}`);
    boxes.forEach((a, index) => boxes.slice(index + 1).forEach((b) => {
        if (a.owner.contains(b.owner) || b.owner.contains(a.owner)) return;
        const width = Math.min(a.rect.right, b.rect.right) - Math.max(a.rect.left, b.rect.left);
        const height = Math.min(a.rect.bottom, b.rect.bottom) - Math.max(a.rect.top, b.rect.top);
        if (width > 1 && height > 2) found.push(`over each other: ${a.text} | ${b.text}`);
    }));
    if (document.documentElement.scrollWidth > innerWidth) found.push(`the page is ${document.documentElement.scrollWidth} px wide`);
    return found;
}"""
CONTROLS = "button:enabled, input:enabled, select:enabled, summary, [tabindex='0']"
MARK_CONTROLS = f"""() => [...document.querySelectorAll("{CONTROLS}")].filter((control) => control.checkVisibility())
    .map((control, index) => {{ control.dataset.reach = index; return control.outerHTML.slice(0, 90); }})"""
FOCUSED = "() => document.activeElement?.dataset?.reach ?? ''"
# Labels of random boxes, placed by the page's own module.
LABELS = """async () => {
    const { place } = await import("/plates.js");
    let seed = 1;
    const random = (most) => { seed = (seed * 48271) % 2147483647; return (seed / 2147483647) * most; };
    for (let round = 0; round < 50; round += 1) {
        const boxes = Array.from({ length: 40 }, () => { const [x, y] = [random(600), random(180)]; return [x, y, x + random(200), y + random(80)]; });
        const placed = place(boxes, boxes.map(() => [70, 14]), [640, 192]).filter((area) => area);
        const apart = placed.every((a, i) => placed.slice(i + 1).every((b) => a[2] <= b[0] || b[2] <= a[0] || a[3] <= b[1] || b[3] <= a[1]));
        const inside = placed.every(([left, top, right, bottom]) => left >= 0 && top >= 0 && right <= 640 && bottom <= 192);
        if (!apart || !inside || placed.length < 12) return `round ${round}: ${placed.length} labels`;
    }
    return "";
}"""


def wait(page, script, argument=None):
    page.wait_for_function(script, arg=argument, timeout=PATIENCE_MS)


def wait_text(page, id, part):
    wait(page, "([id, part]) => document.getElementById(id).checkVisibility() && document.getElementById(id).textContent.includes(part)", [id, part])


class Relay:
    """Stands between the page and the viewer, so that a connection can end with a question on its way."""

    def __init__(self, page):
        self.sockets, self.deaf, self.pixel = [], False, None
        page.route_web_socket("**/socket*", self.open)

    def open(self, socket):
        server = socket.connect_to_server()
        self.sockets.append(socket)
        socket.on_message(lambda message: self.send(server, message))

    def send(self, server, message):
        if "pixel" in message:
            self.pixel = json.loads(message)["pixel"]
        if not self.deaf:
            server.send(message)

    def lose(self, page, ask):
        """Calls `ask`, whose message does not arrive, and waits for the next connection."""
        self.deaf, before = True, len(self.sockets)
        ask()
        page.wait_for_timeout(500)
        self.deaf = False
        self.sockets[-1].close()
        wait_text(page, "notice", "The viewer has gone")
        while len(self.sockets) == before:
            page.wait_for_timeout(100)


def stamps_agree(page, frames):
    """Follows the page over so many moments, all images of which must have one stamp."""
    page.evaluate(MOMENTS)
    wait(page, f"() => window.moments.length >= {frames}")
    moments = page.evaluate("() => window.moments")
    mixed = [stamps for stamps in moments if len(stamps) != 1]
    check(not mixed, f"all images of a moment have one stamp, over {len(moments)} changes of the page: {mixed[:3]}")


def open_tab(page, name):
    page.click(f"#{name}-tab")
    page.wait_for_selector(TABS[name], timeout=PATIENCE_MS)


def turn_the_tabs(page):
    """One tab at a time shows its content, by mouse and by keyboard, and the address keeps it."""
    seen = "() => [...document.querySelectorAll('[role=tabpanel]')].filter((panel) => panel.checkVisibility()).map(({ id }) => id)"
    for name in TABS:
        open_tab(page, name)
        chosen = page.locator("[role=tab][aria-selected=true]").all_text_contents()
        check(page.evaluate(seen) == [f"{name}-panel"] and [word.lower() for word in chosen] == [name], f"the tab {name} shows its content alone")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    wait(page, "() => document.activeElement.id === 'nodes-tab' && document.getElementById('nodes-panel').checkVisibility()")
    page.get_by_role("radio", name="Large").click()
    kept = page.url
    check(kept.endswith("#nodes") and "layout=one" in kept, f"arrow keys turn the tabs, and a change of the view keeps the tab: {kept}")
    page.goto("about:blank")
    page.goto(kept)
    page.wait_for_selector(TABS["nodes"], timeout=PATIENCE_MS)
    large = page.get_by_role("radio", name="Large").get_attribute("aria-checked")
    check(page.evaluate(seen) == ["nodes-panel"] and large == "true", "the address shows the same view again")
    page.get_by_role("radio", name="Grid").click()
    page.evaluate("() => document.activeElement.blur()")
    page.keyboard.press("/")
    check(page.evaluate(seen) == ["parameters-panel"] and page.evaluate("() => document.activeElement.id") == "search", "/ searches the parameters")
    page.keyboard.press("Escape")
    open_tab(page, "look")


def follow_the_input(page):
    page.select_option("#input", "modulo")
    wait(page, f"(topic) => /box/.test(({CAPTION})(topic))", "/modulo")
    read = subprocess.run([MODULO, "param", "get", "/detector", "input"], capture_output=True, text=True, check=True)
    check("modulo" in read.stdout, "the switch changes the input of the detector, and the boxes follow")
    page.select_option("#input", "recovered")
    wait(page, f"(topic) => /box/.test(({CAPTION})(topic))", "/recovered")
    wait(page, f"(topic) => !/box/.test(({CAPTION})(topic))", "/modulo")
    check(True, "no boxes are drawn on the stream that the detector has left")


def look_at_pixels(page, relay):
    box = page.locator(".large .picture").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    rows = "() => document.querySelectorAll('#pixel tr').length >= 2"
    wait(page, rows)
    codes, light = page.evaluate(PIXEL, "/modulo"), page.evaluate(PIXEL, "/recovered")
    # The recovered image has steps of alpha / 255, and is shown with two digits.
    sums = [int(below.removeprefix("k ")) + int(code) / 255 - float(radiance) for (code, below), (_, radiance) in zip(codes, light)]
    check(len(sums) == 3 and all(abs(far) < 0.03 for far in sums), f"code, wraps k and radiance of the pixel agree: {codes} {light}")
    look_at_an_earlier_one(page, relay)
    relay.lose(page, lambda: page.mouse.move(box["x"] + 3, box["y"] + 3))
    wait(page, f"(topic) => ({MEAN})(topic) > 5", "/recovered")
    page.evaluate("() => document.querySelector('#pixel table').replaceChildren()")
    page.mouse.move(box["x"] + box["width"] / 3, box["y"] + box["height"] / 3)
    wait(page, rows)
    check(True, "the page says that the connection is lost, and goes on with the next one")


def look_at_an_earlier_one(page, relay):
    page.click("#live")
    page.evaluate("() => document.activeElement.blur()")
    before = page.evaluate(STAMP, "/modulo")
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    wait(page, f"(before) => ({STAMP})('/modulo') !== before", before)
    box = page.locator(".large .picture").first.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 4, box["y"] + box["height"] / 3)
    page.wait_for_timeout(1000)
    asked = {topic: f"{seconds}.{nanos:09}" for topic, (seconds, nanos) in relay.pixel["images"]}
    shown = {topic: page.evaluate(STAMP, topic) for topic in ["/modulo", "/recovered"]}
    check(shown.items() <= asked.items() and len(page.evaluate(PIXEL, "/modulo")) == 3, f"the pixel is that of the shown frame: {asked} {shown}")
    page.keyboard.press("Escape")


def zoom_in(page):
    """Ctrl and the wheel zoom into all streams alike, at the pixel under the pointer; a drag moves them."""
    box = page.locator(".large .picture").first.bounding_box()
    at = [box["x"] + 0.7 * box["width"], box["y"] + 0.4 * box["height"]]
    pixel = "() => document.getElementById('pixel').textContent.match(/Column ([0-9]+), row ([0-9]+)/)?.slice(1).map(Number) ?? []"
    page.mouse.move(*at)
    wait(page, f"() => ({pixel})().length === 2")
    page.wait_for_timeout(300)
    before = page.evaluate(pixel)
    page.keyboard.down("Control")
    page.mouse.wheel(0, -400)
    page.keyboard.up("Control")
    page.mouse.move(at[0] + 1, at[1])
    page.wait_for_timeout(500)
    after, zoomed = page.evaluate(pixel), page.locator(".picture.zoomed").count()
    shapes = page.evaluate("() => [...new Set([...document.querySelectorAll('.large .picture canvas.image')].map(({ style }) => style.transform))]")
    near = all(abs(a - b) <= 1 for a, b in zip(before, after))
    check(near and zoomed >= 2 and shapes[0].startswith("scale(4)") and len(shapes) == 1, f"the wheel zooms at the pixel {before}, {after}: {shapes}")
    page.mouse.down()
    page.mouse.move(at[0] - 60, at[1], steps=4)
    page.mouse.up()
    page.mouse.move(*at)
    page.wait_for_timeout(500)
    check(page.evaluate(pixel)[0] > after[0] + 5, f"a drag moves the images: {page.evaluate(pixel)}")
    page.keyboard.press("0")
    check(page.locator(".picture.zoomed").count() == 0, "0 shows the whole images again")


def stop_in_the_strip(page):
    """A click in the strip shows the frame of that time with its boxes."""
    open_tab(page, "time")
    wait(page, "() => document.querySelector('.kept').clientWidth > 8")
    kept, plots = page.locator(".kept").bounding_box(), page.locator(".plots").bounding_box()
    page.mouse.click(kept["x"] + kept["width"] / 2, plots["y"] + 60)
    wait(page, "() => document.getElementById('live').textContent === 'Play'")
    page.mouse.move(5, 5)
    page.wait_for_timeout(500)
    shown, stamp = page.evaluate(CAPTION, "/recovered"), page.evaluate(STAMP, "/recovered")
    told = page.evaluate("() => document.querySelector('.readout').textContent")
    # The detector may have answered the other stream then.
    captions = [page.evaluate(CAPTION, topic) for topic in ["/modulo", "/recovered"]]
    count = sum(int(number) for caption in captions for number in re.findall(r"(\d+) box", caption))
    counts = [int(word) for word in told.split(";")[-1].replace(",", " ").split() if word.isdigit()]
    check(re.search(r"frame \d+", shown)[0] + "," in told and sum(counts) == count, f"a click in the strip shows that frame and its boxes: {captions} | {told}")
    page.wait_for_timeout(1500)
    check(page.evaluate(STAMP, "/recovered") == stamp, "the page stays at that frame")
    page.keyboard.press("ArrowLeft")
    wait(page, f"(before) => ({STAMP})('/recovered') !== before", stamp)
    page.keyboard.press("Escape")
    wait(page, "() => document.getElementById('live').textContent === 'Pause'")
    check(True, "an arrow key shows the frame before, escape goes on")


def set_parameters(page):
    open_tab(page, "parameters")
    page.fill("#search", "score_threshold")
    field = page.locator(".field:visible", has=page.locator("label", has_text="score_threshold"))
    check(field.count() == 1, "the search finds the parameter")
    value = field.locator("input[type='text']")
    value.fill("7")
    value.press("Enter")
    refusal = field.locator(".refused")
    wait(page, "() => [...document.querySelectorAll('.refused')].some((text) => text.textContent)")
    check("score_threshold" in refusal.text_content() and value.input_value() == "0.25", f"a refused value shows the node's sentence: {refusal.text_content()}")
    value.fill("0.4")
    value.press("Enter")
    reset = field.locator(".reset")
    reset.wait_for(state="visible", timeout=PATIENCE_MS)
    check(refusal.text_content() == "", "an accepted value takes the sentence away")
    reset.click()
    reset.wait_for(state="hidden", timeout=PATIENCE_MS)
    read = subprocess.run([MODULO, "param", "get", "/detector", "score_threshold"], capture_output=True, text=True, check=True)
    check("0.25" in read.stdout, "the default is set again")
    page.fill("#search", "")


def fit_each_window(page, folder):
    check(page.evaluate(LABELS) == "", "labels of boxes never cover each other")
    for scheme in ["light", "dark"]:
        page.emulate_media(color_scheme=scheme)
        for width, height in WIDTHS.items():
            page.set_viewport_size({"width": width, "height": height})
            for tab in TABS:
                open_tab(page, tab)
                fit_the_tab(page, tab, scheme, width, folder)
    page.set_viewport_size({"width": 1500, "height": 1000})


def fit_the_tab(page, tab, scheme, width, folder):
    page.evaluate("() => window.scrollTo(0, 0)")
    page.wait_for_timeout(900)
    if folder:
        page.screenshot(path=f"{folder}/{tab}_{scheme}_{width}.png", full_page=True)
    tall = page.evaluate("() => document.documentElement.scrollHeight")
    # With everything unfolded there is the most that can collide.
    page.evaluate("() => document.querySelectorAll('details').forEach((details) => { details.open = true; })")
    page.wait_for_timeout(900)
    clashes, faults = page.evaluate(CLASHES), Axe().run(page).response["violations"]
    check(not faults, f"{tab}, {width} px, {scheme}: axe finds nothing: {[(fault['id'], fault['nodes'][0]['html']) for fault in faults]}")
    check(not clashes and tall < 3000, f"{tab}, {width} px, {scheme}: no text over another one, nothing outside of the page of {tall} px: {clashes[:5]}")
    page.evaluate("() => document.querySelectorAll('details').forEach((details) => { details.open = false; })")
    if scheme == "dark":
        reach_by_keyboard(page, width)


def reach_by_keyboard(page, width):
    page.click("#live")
    page.evaluate("() => { document.activeElement.blur(); window.scrollTo(0, 0); }")
    wanted = page.evaluate(MARK_CONTROLS)
    reached = set()
    for _ in range(len(wanted) + 8):
        page.keyboard.press("Tab")
        reached.add(page.evaluate(FOCUSED))
    missed = [control for index, control in enumerate(wanted) if str(index) not in reached]
    check(not missed, f"{width} px: the keyboard reaches all {len(wanted)} controls: {missed[:3]}")
    page.evaluate("() => document.activeElement.blur()")
    page.keyboard.press("Escape")


def drive_the_replay(page):
    page.get_by_role("button", name="Pause the replay").click()
    wait_text(page, "notice", "The replay is paused")
    # What was on its way when the player paused.
    page.wait_for_timeout(1500)
    # The second place shows that the images follow, wherever the player had paused. The frame there is played at once.
    for seconds in [0.5, 1.75]:
        page.get_by_label("Time of the recording").fill(str(seconds))
        is_near = f"(topic, stamp) => ({STAMP})(topic) >= stamp && ({STAMP})(topic) < stamp + 0.6"
        is_at = f"(topic, stamp) => ({is_near})(topic, stamp) && /box/.test(({CAPTION})(topic)) === (topic === '/recovered')"
        whole = f"(stamp) => ['/modulo', '/recovered'].every((topic) => ({is_at})(topic, stamp))"
        wait(page, whole, seconds)
    wait(page, "() => /^[12][.][0-9] of 2[.]8 s$/.test(document.querySelector('#replay output').textContent)")
    check(True, "the bar says where the replay is")
    stamp = page.evaluate(STAMP, "/modulo")
    for _ in range(4):
        page.get_by_role("button", name="Next message").click()
        page.wait_for_timeout(500)
    wait(page, f"(stamp) => ({STAMP})('/modulo') !== stamp", stamp)
    check(True, "a paused replay says so, seeks and plays single messages, whose images and boxes come together")
    page.get_by_role("button", name="Play the replay").click()
    wait(page, "() => document.getElementById('notice').hidden")


def lose_a_node(page):
    """A node that is killed is told, and the page goes on when it is back."""
    open_tab(page, "nodes")
    colours = page.evaluate(COLOURS)
    found = subprocess.run(["pgrep", "-f", f"^{MODULO} run detector"], capture_output=True, text=True, check=True)
    for pid in found.stdout.split():
        if f"ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']}" in Path(f"/proc/{pid}/environ").read_text().split("\0"):
            os.kill(int(pid), signal.SIGKILL)
    wait_text(page, "notice", "Gone: detector")
    wait(page, "() => document.querySelectorAll('article.gone').length === 1")
    check(len(set(colours.values())) == 3 and page.evaluate(COLOURS) == colours, f"a killed node is told and red, and all nodes keep their colours: {colours}")
    again = subprocess.Popen([MODULO, "run", "detector", "--ros-args", "-p", "engine:=rten"], cwd=ROOT, start_new_session=True)
    try:
        wait(page, "() => !document.querySelector('article.gone')")
        wait(page, f"(topic) => /[1-9][0-9]* box/.test(({CAPTION})(topic))", "/recovered")
        check(page.evaluate(COLOURS) == colours, "the page goes on with its boxes when it is back")
    finally:
        os.killpg(again.pid, signal.SIGTERM)


def drive(page, address, folder):
    errors, places = [], set()
    relay = Relay(page)
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda why: errors.append(str(why)))
    page.on("request", lambda request: places.add(request.url.split("/")[2]) if request.url.startswith("http") else None)
    page.goto(address)
    for topic in ["/modulo", "/recovered"]:
        wait(page, f"(topic) => ({MEAN})(topic) > 5", topic)
        check(True, f"the page shows {topic}")
    wait(page, f"(topic) => /[1-9][0-9]* box/.test(({CAPTION})(topic))", "/recovered")
    check(True, "boxes are drawn on /recovered")
    stamps_agree(page, 20)
    wait_text(page, "link", f"Domain {os.environ['ROS_DOMAIN_ID']}: 3 nodes")
    check(True, "the page says the domain and the number of nodes")
    check(page.evaluate(SCORES) == ["found 1 of 2 of /ideal", "found 1 of 1", ""], f"images are scored by labels, else by the ideal image: {page.evaluate(SCORES)}")
    turn_the_tabs(page)
    open_tab(page, "parameters")
    first = page.evaluate("""() => [...document.querySelectorAll("details.node")].map((node) =>
        [node.querySelector("summary").textContent, node.querySelector(".field label").textContent])""")
    check(["/unwrap", "alpha"] in first and ["/detector", "score_threshold"] in first, f"what is changed most comes first: {first}")
    lens = page.evaluate("""() => [...document.querySelectorAll("input[type=range]")].filter(({ ariaLabel }) => ariaLabel === "psf_sigma, slider")
        .map(({ min, max }) => [min, max])""")
    check(lens and all(most == "3" for _, most in lens), f"the slider of the lens has the useful range: {lens}")
    open_tab(page, "look")
    follow_the_input(page)
    look_at_pixels(page, relay)
    zoom_in(page)
    stop_in_the_strip(page)
    set_parameters(page)
    fit_each_window(page, folder)
    drive_the_replay(page)
    lose_a_node(page)
    check(not errors, f"no error on the console: {errors}")
    check(places == {address.split("/")[2]}, f"no request outside of the page's origin: {places}")
    # The refusal itself is an error on the console.
    check(page.evaluate(WITHOUT_TOKEN) == "refused", "a script without the token cannot connect")


def show_two_cameras(page, address):
    """Two cameras have no stamp in common: the page shows one stream of each, and none waits for the other one."""
    page.goto(address)
    topics = ["/front/metered", "/rear/metered"]
    for topic in topics:
        wait(page, f"(topic) => /[1-9][0-9]* box/.test(({CAPTION})(topic))", topic)
    open_tab(page, "time")
    stamps, strips = {topic: set() for topic in topics}, set()
    for _ in range(50):
        page.wait_for_timeout(200)
        strips.add(page.evaluate("() => document.querySelector('.kept').style.cssText"))
        for topic in topics:
            stamps[topic].add(page.evaluate(STAMP, topic))
    counts = [len(stamps[topic] - {""}) for topic in topics]
    # A moment that waited for both would be shown once a second.
    check(min(counts) >= 6 and sum(counts) >= 16 and not any("" in all for all in stamps.values()),
          f"each of two cameras goes on by itself: {counts} frames in 10 s")
    check(len(strips) >= 15, f"the strip of time goes on with them: drawn {len(strips)} times")


def keep_the_boxes(page, address, folder):
    """Six detectors on a machine that has other work: no frame is shown without its boxes, and no line between nodes is false."""
    page.goto(address)
    page.wait_for_function(f"() => (({LOOK})()).length >= 2 && (({LOOK})()).every(([, , answers]) => Number(answers) > 0)", timeout=3 * PATIENCE_MS)
    check_edges(page)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
    try:
        looks = []
        for _ in range(200):
            looks.append(page.evaluate(LOOK))
            page.wait_for_timeout(100)
    finally:
        for process in busy:
            process.kill()
            process.wait()
    bare = [(topic, stamp) for look in looks for topic, stamp, answers, *_ in look if not (stamp and answers == "1")]
    moments = {stamp for look in looks for _, stamp, *_ in look}
    check(not bare, f"200 looks at {len(looks[0])} streams, {len(moments)} moments: each shown frame has its boxes: {len(bare)} have none: {bare[:3]}")
    check(len(moments) >= 3, "the page goes on")
    wait(page, "() => /found [0-9]+ of [0-9]+/.test(document.querySelector('.large').innerText)")
    trust = [(trust, text) for topic, _, _, trust, text in page.evaluate(LOOK) if topic == "/recovered"]
    check(trust and trust[0][0] in ["true", "false"] and "trusted" in trust[0][1], f"the unwrapped stream says its trust: {trust}")
    subprocess.run([MODULO, "param", "set", "/modulo_camera", "alpha", "16.0"], check=True, capture_output=True)
    wait(page, "() => /not trusted: ./.test(document.querySelector('.picture[data-trust=false] .badge')?.textContent)")
    check(True, "a frame that is not trusted says why: " + page.evaluate("() => document.querySelector('[data-trust=false] .badge').textContent"))
    if folder:
        for scheme in ["light", "dark"]:
            page.emulate_media(color_scheme=scheme)
            for width, height in WIDTHS.items():
                page.set_viewport_size({"width": width, "height": height})
                page.wait_for_timeout(1500)
                page.screenshot(path=f"{folder}/compare_{scheme}_{width}.png", full_page=True)


def check_edges(page):
    open_tab(page, "nodes")
    wanted = set()
    for topic in ["modulo", "recovered", "metered", "saturated", "auto_exposed", "ideal"]:
        info = subprocess.run([MODULO, "topic", "info", "-v", f"/{topic}"], capture_output=True, text=True, check=True).stdout
        senders, readers = (re.findall(r"^  /(\w+):", part, re.MULTILINE) for part in info.split("Subscription count"))
        wanted |= {f"{sender} -> {reader}" for sender in senders for reader in readers if reader != "viewer"}
    wanted = sorted(wanted)
    for width in [390, 820, 1500, 2560]:
        page.set_viewport_size({"width": width, "height": WIDTHS[width]})
        page.wait_for_timeout(1500)
        drawn = page.evaluate(EDGES)
        check(drawn == wanted, f"{width} px: the lines between nodes are the real ones, {wanted}: {drawn if drawn != wanted else ''}")
    page.set_viewport_size({"width": 1500, "height": 1000})


def show_the_bag(page, address):
    """A bag is replayed beside the viewer, as it was recorded."""
    page.goto(address)
    wait(page, f"(topic) => ({MEAN})(topic) > 5", "/modulo")
    page.get_by_role("button", name="Pause the replay").click()
    wait_text(page, "notice", "The replay is paused")
    check(True, "`modulo view BAG` shows the bag, and its replay can be paused")


def expose_the_past(page, address, model):
    """A bag of an evaluation shows its boxes; another exposure of a frame of it has boxes of its own, as long as the model is there."""
    exposure, shown = page.get_by_role("slider", name="Exposure"), f"(part) => new RegExp(part).test(({CAPTION})('/recovered'))"
    page.goto(address)
    wait(page, shown, "[1-9][0-9]* box(es)?,")
    check(True, "`modulo view` draws the boxes of a bag of `modulo eval --bag`")
    page.get_by_role("button", name="Pause the replay").click()
    page.click("#live")
    page.wait_for_timeout(1500)
    before, caption = page.evaluate(MEAN, "/recovered"), page.evaluate(CAPTION, "/recovered")
    away = model.rename(model.with_suffix(".away"))
    exposure.fill("1")
    wait_text(page, "notice", "The boxes are those of the original exposure: ")
    wait(page, shown, "box(es)? of the original exposure")
    check(str(model) in page.inner_text("#notice"), f"the page says why no boxes are found anew: {page.inner_text('#notice')}")
    away.rename(model)
    exposure.fill("2")
    wait(page, shown, "box(es)? found anew")
    check(page.evaluate(MEAN, "/recovered") > before + 10, f"two stops more are brighter, with boxes of their own: {page.evaluate(CAPTION, '/recovered')}")
    exposure.fill("-6")
    wait(page, shown, "(^|, )0 boxes found anew")
    check(page.evaluate(MEAN, "/recovered") < before, "six stops less are dark, and the detector finds nothing")
    exposure.fill("0")
    wait(page, f"(before) => Math.abs(({MEAN})('/recovered') - before) < 0.01", before)
    boxes = re.compile(r"\d+ box(es)?(,|$)")
    check(boxes.search(page.evaluate(CAPTION, "/recovered"))[0] == boxes.search(caption)[0], f"the original exposure has its boxes again: {caption}")


def bag_of_an_evaluation(folder):
    """A bag with the boxes of a model that lies in `folder`."""
    model = shutil.copy(ROOT / "crates/models/demo.onnx", folder / "model.onnx")
    scene = ["source:=scene://glare?seed=1&frames=3&width=640&height=192", f"model:={model}"]
    topics = ["/sensor_info", "/modulo", "/recovered", "/detector/detections"]
    command = [MODULO, "eval", "recovered.launch.yaml", *scene, "--bag", folder / "bag", "--topics", *topics, "-o", folder / "out"]
    subprocess.run(command, check=True, capture_output=True)
    return folder / "bag", Path(model)


def open_the_recording(page, file, topics):
    errors = []
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda why: errors.append(str(why)))
    page.goto(f"file://{file}")
    for topic in topics:
        wait(page, f"(topic) => ({MEAN})(topic) > 5", topic)
    before = [page.evaluate(STAMP, topic) for topic in topics]
    # A moment has new images of one camera only.
    for topic, stamp in zip(topics, before):
        for _ in range(20):
            if page.evaluate(STAMP, topic) == stamp:
                page.keyboard.press("ArrowLeft")
                page.wait_for_timeout(200)
        check(page.evaluate(STAMP, topic) != stamp, f"an arrow key shows the frame of {topic} before that of the recording's end")
    page.click("#live")
    wait(page, f"([topic, stamp]) => ({STAMP})(topic) !== stamp", [topics[0], page.evaluate(STAMP, topics[0])])
    page.click("#live")
    page.get_by_label("Time of the recording").fill("0")
    wait(page, "() => document.querySelector('#replay output').textContent.startsWith('0.0 of')")
    check(True, "a recording plays, and its bar goes to each frame")
    open_tab(page, "time")
    for width in [900, 1400]:
        page.set_viewport_size({"width": width, "height": 1000})
    page.wait_for_timeout(500)
    widths = page.evaluate("() => [document.querySelector('.plots canvas').clientWidth, document.querySelector('.plots canvas').width]")
    check(widths[0] == widths[1], f"the strip of a recording follows the window: {widths}")
    clashes = page.evaluate(CLASHES)
    check(not clashes and not errors, f"a recording of {file.stat().st_size >> 10} KiB shows its frames without a viewer: {clashes[:3]} {errors}")


class Proxy(socketserver.ThreadingTCPServer):
    """A reverse proxy that serves the viewer below /modulo/, and passes on the host of the browser or hides it."""

    daemon_threads = True

    def __init__(self, upstream):
        self.upstream, self.passes_host = upstream, True
        super().__init__(("127.0.0.1", 0), Proxied)
        threading.Thread(target=self.serve_forever, daemon=True).start()


class Proxied(socketserver.StreamRequestHandler):
    def handle(self):
        method, path, _ = self.rfile.readline().decode().split()
        headers = dict(line.decode().strip().split(": ", 1) for line in iter(self.rfile.readline, b"\r\n"))
        if not self.server.passes_host:
            headers["Host"] = "%s:%d" % self.server.upstream
        if "Upgrade" not in headers:
            headers["Connection"] = "close"
        head = [f"{method} {path.removeprefix('/modulo')} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
        with socket.create_connection(self.server.upstream) as viewer:
            viewer.sendall("\r\n".join([*head, "", ""]).encode())
            threading.Thread(target=self.answer, args=(viewer,), daemon=True).start()
            while asked := self.rfile.read1():
                viewer.sendall(asked)

    def answer(self, viewer):
        with contextlib.suppress(OSError):
            while answered := viewer.recv(1 << 16):
                self.connection.sendall(answered)
            self.connection.shutdown(socket.SHUT_RDWR)


def look_through_a_proxy(page, at):
    """The page works below a path, and says what is wrong where the proxy hides the host that the browser asks for."""
    place, token = at.removeprefix("http://").split("/")
    host, port = place.split(":")
    with Proxy((host, int(port))) as proxy:
        page.goto(f"http://127.0.0.1:{proxy.server_address[1]}/modulo/{token}")
        wait(page, f"(topic) => ({MEAN})(topic) > 5", "/recovered")
        check(True, "the page shows a frame behind a reverse proxy, below a path")
        proxy.passes_host = False
        page.reload()
        wait_text(page, "notice", "proxy_set_header Host $http_host;")
        check(True, "the page says what a proxy that hides its host has to pass on")
        proxy.shutdown()


def opened(browser):
    """A page that is closed before the next one: one without its viewer goes on trying to connect."""
    return browser.new_page(viewport={"width": 1500, "height": 1000})


def main():
    global MODULO
    MODULO, folder = str(Path(sys.argv[1]).resolve()), (sys.argv[2:] or [None])[0]
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        recordings = [Path(scratch) / name for name in ["one.html", "two.html"]]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        with viewer(MODULO, "139", "--record", str(recordings[0])) as process, opened(browser) as page:
            drive(page, address(process, "http://"), folder)
        with viewer(MODULO, "143") as process, opened(browser) as page:
            look_through_a_proxy(page, address(process, "http://"))
        # Each suite has a domain of its own: the nodes of the one before may still be ending.
        scenes = [f"{camera}:=scene://{scene}?seed=3&frames=100000" for camera, scene in {"front": "tunnel", "rear": "glare"}.items()]
        suite = [["launch", "launch/cameras.launch.yaml", "shared:=true", "engine:=rten", *scenes]]
        with viewer(MODULO, "140", "--record", str(recordings[1]), suite=suite) as process, opened(browser) as page:
            show_two_cameras(page, address(process, "http://"))
        suite = [["launch", "launch/compare.launch.yaml", "engine:=rten", "rate:=10", "loop:=true", "source:=scene://day?seed=3&frames=20&width=320&height=96"]]
        with viewer(MODULO, "141", suite=suite) as process, opened(browser) as page:
            keep_the_boxes(page, address(process, "http://"), folder)
        with viewer(MODULO, "142", str(BAG), suite=[]) as process, opened(browser) as page:
            show_the_bag(page, address(process, "http://"))
        bag, model = bag_of_an_evaluation(Path(scratch))
        with viewer(MODULO, "144", str(bag), suite=[]) as process, opened(browser) as page:
            expose_the_past(page, address(process, "http://"), model)
        left = subprocess.run(["pgrep", "-f", f"bag play --loop {BAG}"], capture_output=True, text=True).stdout
        check(not left, f"the replay ends with the viewer: {left}")
        for recording, topics in zip(recordings, [["/recovered"], ["/front/metered", "/rear/metered"]]):
            with opened(browser) as page:
                open_the_recording(page, recording, topics)
        browser.close()


if __name__ == "__main__":
    main()
