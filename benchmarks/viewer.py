"""Latency and frame rate of the live page in software rendering: `python benchmarks/viewer.py`.

A headless Chromium draws 800 x 600 pixels on the processor, which also runs the server.  Latency is from a
dragged target, in the page, to the end of the frame that first shows a body moved by it; pixels are read
back, so that what is still being drawn counts.  Asked: a median below 50 ms, and 30 frames per second with
everything shown.  The processor time of a frame, of all the browser's processes, tells what a machine can do
that has nothing else to do: times and rates themselves follow its load.
"""

import os
from pathlib import Path

import numpy as np

import pepper_kin as pk
from pepper_kin.viewer import find_chromium
from pepper_kin.viewer.browser import CHROMIUM_FLAGS
from pepper_kin.viewer.joint_motion import JointMotion
from pepper_kin.viewer.server import ViewerServer
from pepper_kin.viewer.server.planning import show_motion

PANEL = 348  # pixels beside the picture
DRAGS, SECONDS = 200, 4.0

DRAG = """async (count) => {
    const { viewer, parts } = pepperKin;
    const gl = viewer.renderer.getContext(), pixel = new Uint8Array(4), sent = new Map(), taken = [];
    const listen = (stamp) => {
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        for (const [key, time] of sent) {
            if (key > stamp) continue;
            taken.push(performance.now() - time);
            sent.delete(key);
        }
    };
    parts.scene.drawnListeners.push(listen);
    const start = parts.scene.place('@left hand');
    for (let k = 0; k < count; k++) {
        const way = [0.04, 0.04 * Math.sin(k / 15), 0.05 * Math.cos(k / 15)];
        parts.targets.move("left hand", start.map((x, axis) => x + way[axis]));
        sent.set(parts.targets.stamp, performance.now());
        await new Promise((done) => setTimeout(done, 25));
    }
    await new Promise((done) => setTimeout(done, 500));
    parts.scene.drawnListeners.pop();
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


def frames(page):
    """Frames per second, and the processor time of one [ms]."""
    before = processor_time()
    count, seconds = page.evaluate(FRAMES, SECONDS)
    each = 1000 * (processor_time() - before) / max(count, 1)
    return f"{count / seconds:5.1f} per second, {each:4.0f} ms of processor time each"


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


def main():
    from playwright.sync_api import sync_playwright

    pepper = pk.load_pepper()
    server = ViewerServer(pepper, port=0)
    server.warm_up()
    with sync_playwright() as playwright:
        flags = [flag for flag in CHROMIUM_FLAGS if flag != "--headless"]
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=flags)
        page = browser.new_page(viewport={"width": 800 + PANEL, "height": 600})
        page.goto(server.url)
        wait(page, "window.pepperKin !== undefined && pepperKin.values.ready?.planner")
        wait(page, "pepperKin.quality.settled")
        start = pepper.joint_vector({"LShoulderPitch": 0.9, "LElbowRoll": -1.0, "LShoulderRoll": 0.2})
        server.call(lambda session: session.set_joints(start))
        latency = np.array(page.evaluate(DRAG, DRAGS))
        quartiles = np.percentile(latency, (10, 50, 90))
        print(f"target to drawn pose, {latency.size} drags: median {quartiles[1]:.0f} ms", end="")
        print(f" (one in ten below {quartiles[0]:.0f}, above {quartiles[2]:.0f} ms)")
        print(f"  drawn at level {page.evaluate('pepperKin.quality.level')} of 0 (finest) to 3")
        shown = show_motion(pepper, swinging(pepper), pk.Scene(), "Swinging")
        server.call(lambda session: session.load(shown, play=True))
        server.call(lambda session: session.set_loop(True))
        for what in ("looks", "everything"):
            if what == "everything":
                for layer in server.call(lambda session: session.available):
                    server.call(lambda session, layer=layer: session.show(layer, True))
            page.wait_for_timeout(4000)
            print(f"{what} shown: {frames(page)}, level {page.evaluate('pepperKin.quality.level')}")
            for fixed in range(4):
                page.evaluate(
                    "(k) => { pepperKin.quality.judge = () => 0; pepperKin.quality.level = k; }", fixed
                )
                page.wait_for_timeout(500)
                print(f"  level {fixed}: {frames(page)}")
            page.evaluate("delete pepperKin.quality.judge")
        drawn = page.evaluate(
            "[pepperKin.viewer.renderer.info.render.calls, pepperKin.viewer.renderer.info.render.triangles]"
        )
        print(f"everything: {drawn[0]} draw calls, {drawn[1]} triangles")
        browser.close()
    server.close()


if __name__ == "__main__":
    main()
