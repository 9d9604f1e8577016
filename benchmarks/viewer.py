"""Latency and frame rate of the live page in software rendering."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from harness import figures

import pepper_kin as pk
from pepper_kin.viewer import find_chromium
from pepper_kin.viewer.browser import CHROMIUM_FLAGS
from pepper_kin.viewer.joint_motion import JointMotion
from pepper_kin.viewer.server import ViewerServer
from pepper_kin.viewer.server.planning import show_motion

PANEL = 348  # pixels beside the picture
MOST_LATENCY, LEAST_RATE = 50.0, 30.0  # [ms], [1/s]: what is asked
PARTS = (
    "to the server", "next tick, with the servo's step", "back to the page", "wait for a frame", "drawing",
)  # fmt: skip

DRAG = """async (count) => {
    const { viewer, parts } = pepperKin, { scene } = parts;
    const gl = viewer.renderer.getContext(), pixel = new Uint8Array(4), waiting = new Map(), taken = [];
    const now = () => performance.timeOrigin + performance.now();
    const pose = scene.pose.bind(scene), draw = scene.drawFrame.bind(scene);
    let begun = 0;
    scene.pose = (values, stamp) => {
        for (const [key, times] of waiting) if (key <= stamp && times.length === 1) times.push(now());
        pose(values, stamp);
    };
    scene.drawFrame = () => {
        begun = now();
        draw();
    };
    const listen = (stamp) => {
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        for (const [key, times] of waiting) {
            if (key > stamp) continue;
            taken.push([key, ...times, begun, now()]);
            waiting.delete(key);
        }
    };
    scene.drawnListeners.push(listen);
    const start = scene.place('@left hand');
    const handle = parts.drag.handles.targets()[parts.robot.targets.indexOf("left hand")];
    for (let k = 0; k < count; k++) {
        const way = [0.04, 0.04 * Math.sin(k / 15), 0.05 * Math.cos(k / 15)];
        const begin = now();
        handle.moved(start.map((x, axis) => x + way[axis]));
        waiting.set(parts.targets.stamp, [begin]);
        await new Promise((done) => setTimeout(done, 25));
    }
    await new Promise((done) => setTimeout(done, 500));
    handle.dropped();
    scene.drawnListeners.pop();
    delete scene.pose;
    delete scene.drawFrame;
    return taken;
}"""

FRAMES = """async (seconds) => {
    const { viewer, parts } = pepperKin;
    const gl = viewer.renderer.getContext(), pixel = new Uint8Array(4);
    const listen = () => gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    parts.scene.drawnListeners.push(listen);
    const before = parts.scene.frames, begin = performance.now();
    await new Promise((done) => setTimeout(done, 1000 * seconds));
    parts.scene.drawnListeners.pop();
    return [parts.scene.frames - before, (performance.now() - begin) / 1000];
}"""


def processor_time():
    """Seconds that all descendants of this process, the browser's, have computed so far."""
    parents, times = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue  # it has just ended
        pid = int(stat.parent.name)
        parents[pid], times[pid] = int(fields[1]), int(fields[11]) + int(fields[12])
    found = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= more
    return sum(times[pid] for pid in found - {os.getpid()}) / os.sysconf("SC_CLK_TCK")


def frames(page, duration):
    """Frames per second, and the processor time of one [ms]."""
    before = processor_time()
    count, seconds = page.evaluate(FRAMES, duration)
    return count / seconds, 1000 * (processor_time() - before) / max(count, 1)


def latencies(page, server, count):
    """Drag a target; return the parts of each latency, shape (drags, 5) [ms]."""
    arrived, packed = {}, {}

    def note(session):
        move, poses = session.move_target, session.poses

        def move_target(name, position, stamp=0):
            arrived[stamp] = 1000 * time.time()
            move(name, position, stamp)

        def noted_poses():
            message = poses()
            packed.setdefault(session.stamp, 1000 * time.time())
            return message

        server._hub._doers["target"] = move_target
        session.poses = noted_poses

    server.call(note)
    rows = []
    for stamp, begin, received, begun, drawn in page.evaluate(DRAG, count):
        sent = min(when for key, when in packed.items() if key >= stamp)
        rows.append(np.diff([begin, arrived[stamp], sent, received, begun, drawn]))
    return np.array(rows)


def wait(page, condition):
    while not page.evaluate(condition):
        page.wait_for_timeout(50)


def swinging(pepper):
    """Both arms, head and hip swing for ten seconds."""
    times = np.linspace(0.0, 10.0, 1001)
    swing = np.zeros(pepper.n)
    for joint in ("LShoulderPitch", "RShoulderPitch", "HeadYaw"):
        swing[pepper.joint_index(joint)] = 0.5
    start = pepper.joint_vector({"LShoulderPitch": 0.8, "RShoulderPitch": 0.8})
    return JointMotion(times, start + np.sin(2 * np.pi * times / 2.0)[:, None] * swing)


def rates(page, server, seconds):
    """Yield frames of visual geometry alone and of everything, whose rate is last [1/s]."""
    head = "shown | level (0 is finest) | frames per second {:.1f} | processor time of one [ms] {:.0f}"
    for what in ("visual", "everything"):
        if what == "everything":
            for layer in server.call(lambda session: session.available):
                server.call(lambda session, layer=layer: session.show(layer, True))
        page.wait_for_timeout(4000)
        rate, cost = frames(page, seconds)
        yield head, what, f"{page.evaluate('pepperKin.quality.level')}, by itself", rate, cost
        for fixed in range(page.evaluate("Quality.MOVING.length")):
            page.evaluate("(k) => { pepperKin.quality.judge = () => 0; pepperKin.quality.level = k; }", fixed)
            page.wait_for_timeout(500)
            yield head, what, fixed, *frames(page, seconds)
        page.evaluate("delete pepperKin.quality.judge")


@figures("benchmarks/viewer.md", "Chromium, playwright", drags=10, seconds=0.5)
def viewer(drags=200, seconds=4.0, swiftshader_compositor=False) -> Iterator[tuple | str]:
    """Latency and frame rate of the live page in software rendering.

    A headless Chromium draws 800 x 600 pixels on the processor, which also runs the server.  Latency is from
    a dragged target, in the page, to the end of the frame that first shows a body moved by it; pixels are
    read back, so that what is still being drawn counts.  Its parts come from the clock that page and server
    share.  The processor time of a frame, of all the browser's processes, tells what a machine can do that
    has nothing else to do: times and rates themselves follow its load.

    The browser composes the page as it does on any machine without a graphics card, by the processor
    (`--disable-gpu`); with `--swiftshader-compositor` also that goes through the graphics library.
    """
    from playwright.sync_api import sync_playwright

    pepper = pk.load_pepper().with_requirements("limits")
    server = ViewerServer(pepper, port=0)
    server.warm_up()
    with sync_playwright() as playwright:
        flags = [flag for flag in CHROMIUM_FLAGS if flag != "--headless"]
        flags += [] if swiftshader_compositor else ["--disable-gpu"]
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=flags)
        page = browser.new_page(viewport={"width": 800 + PANEL, "height": 600})
        page.goto(server.url)
        wait(page, "window.pepperKin !== undefined && pepperKin.values.ready?.planner")
        wait(page, "pepperKin.quality.settled")
        start = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})
        server.call(lambda session: session.set_joints(start))
        parts = latencies(page, server, drags)
        latency = parts.sum(axis=1)
        low, median, high = np.percentile(latency, (10, 50, 90))
        yield (
            f"From a dragged target to the drawn pose, {len(latency)} drags, "
            f"level {page.evaluate('pepperKin.quality.level')}; "
            f"one in ten below {low:.0f}, above {high:.0f} ms:"
        )
        for name, values in zip((*PARTS, "whole"), (*parts.T, latency), strict=True):
            yield "part | median [ms] {:.1f} | mean [ms] {:.1f}", name, np.median(values), values.mean()
        shown = show_motion(pepper, swinging(pepper), pk.Scene(), "Swinging")
        server.call(lambda session: session.load(shown, play=True))
        server.call(lambda session: session.set_loop(True))
        rate = None
        for row in rates(page, server, seconds):
            rate = row[3] if "by itself" in str(row[2]) else rate
            yield row
        head, what = "what | asked | measured | ok", "frames per second, everything shown, 800 x 600"
        asked = f"< {MOST_LATENCY:.0f} ms"
        yield head, "target to drawn pose, median", asked, f"{median:.0f} ms", median < MOST_LATENCY
        yield head, what, f">= {LEAST_RATE:.0f}", f"{rate:.1f}", rate >= LEAST_RATE
        drawn = page.evaluate(
            "[pepperKin.viewer.renderer.info.render.calls, pepperKin.viewer.renderer.info.render.triangles]"
        )
        yield f"Everything: {drawn[0]} draw calls, {drawn[1]} triangles."
        browser.close()
    server.close()
