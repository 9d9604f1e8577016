"use strict";
// The panel: buttons, slider, keys and the address' options (#t=1.5&view=front&panel=0&plots=1&play=1).
(() => {
  const element = (id) => document.getElementById(id);
  const STEP = 0.1; // seconds per arrow key
  const HUE = 211; // of the first curve

  function fail(error) {
    element("failure").textContent = `This page cannot draw: ${error.message}. It needs a browser with WebGL.`;
    element("failure").hidden = false;
    document.body.classList.add("bare");
  }

  function connectTimeline(motion) {
    const [play, scrub, clock] = ["play", "scrub", "clock"].map(element);
    const now = document.createElement("b");
    const whole = document.createElement("span");
    whole.textContent = ` / ${motion.end.toFixed(2)} s`;
    clock.append(now, whole);
    scrub.min = motion.start;
    scrub.max = motion.end;
    play.addEventListener("click", () => (motion.playing ? motion.pause() : motion.play()));
    scrub.addEventListener("input", () => {
      const time = Number(scrub.value); // pausing tells the panel, which sets the slider
      motion.pause();
      motion.seek(time);
    });
    motion.listeners.push(() => {
      scrub.value = motion.time;
      now.textContent = motion.time.toFixed(2);
      play.classList.toggle("playing", motion.playing);
      play.setAttribute("aria-label", motion.playing ? "Pause" : "Play");
    });
    element("speed").addEventListener("change", (event) => (motion.speed = Number(event.target.value)));
    element("loop").addEventListener("click", () => {
      motion.loop = !motion.loop;
      element("loop").setAttribute("aria-pressed", motion.loop);
    });
  }

  function connectCamera(viewer, points) {
    const look = (name) => {
      stage.fitWindow(viewer);
      stage.look(viewer, points, name);
    };
    document.querySelectorAll("[data-view]").forEach((button) => {
      button.addEventListener("click", () => {
        stage.forgetCamera(button.dataset.view);
        look(button.dataset.view);
      });
    });
    stage.keepCamera(viewer);
    // meshcat sets the pane's size itself after loading and on resizing: come after it.
    window.addEventListener("load", () => stage.fitWindow(viewer));
    window.addEventListener("resize", () => stage.fitWindow(viewer));
    requestAnimationFrame(() => stage.fitWindow(viewer));
    return look;
  }

  function connectPlots(viewer, motion, { motion: { series }, ghost, notes }) {
    const [list, button] = ["plots", "show-plots"].map(element);
    const plots = series.map((curve, k) => {
      const spans = notes.filter((note) => note.curve === curve.name);
      // Beside those of a ghost, all curves have one color.
      return new Plot(list, motion, curve, { hue: ghost ? HUE : (HUE + 47 * k) % 360, ghost, spans });
    });
    const draw = () => list.hidden || plots.forEach((plot) => plot.draw());
    const show = (visible) => {
      list.hidden = !visible;
      button.setAttribute("aria-pressed", visible);
      stage.fitWindow(viewer);
      draw();
    };
    button.hidden = plots.length === 0;
    button.addEventListener("click", () => show(list.hidden));
    window.addEventListener("resize", draw);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
    motion.listeners.push(draw);
    return show;
  }

  // Draw what touches in red, and say it, while the motion is at such a time.
  function connectTouches(viewer, motion, touches) {
    const line = element("contact");
    const path = (name) => name.replaceAll("/", "_");
    const own = (name) => name.replace(/^\d+ /, "");
    let shown;
    const show = () => {
      const time = motion.times[motion.locate(motion.time)[0]];
      const now = touches.find(({ start, end }) => time >= start && time <= end) ?? null;
      if (now === shown) return;
      shown = now;
      line.hidden = !now;
      line.textContent = now?.text ?? "";
      const links = new Set(now?.links.map(path));
      const objects = new Set(now?.objects.map(path));
      for (const link of viewer.scene_tree.find(["links"]).object.children) {
        stage.tint(link, links.has(link.name));
        link.children.forEach((part) => objects.has(own(part.name)) && stage.tint(part, true));
      }
      viewer.scene_tree.find(["world"]).object.children.forEach((part) => stage.tint(part, objects.has(own(part.name))));
      viewer.set_dirty();
    };
    motion.listeners.push(show);
    show();
  }

  // List what is said of the present time.
  function connectNotes(motion, notes) {
    const list = element("notes");
    let shown = "";
    const show = () => {
      const texts = notes.filter(({ start, end }) => motion.time >= start && motion.time <= end).map(({ text }) => text);
      if (texts.join("\n") === shown) return;
      shown = texts.join("\n");
      list.replaceChildren(...texts.map((text) => Object.assign(document.createElement("div"), { textContent: text })));
    };
    motion.listeners.push(show);
    show();
  }

  function connectKeys(motion) {
    const click = (selector) => () => document.querySelector(selector).click();
    const jump = (time) => {
      motion.pause();
      motion.seek(time);
    };
    const actions = {
      " ": click("#play"),
      ArrowLeft: (event) => jump(motion.time - (event.shiftKey ? 10 : 1) * STEP),
      ArrowRight: (event) => jump(motion.time + (event.shiftKey ? 10 : 1) * STEP),
      Home: () => jump(motion.start),
      End: () => jump(motion.end),
      l: click("#loop"),
      p: click("#show-plots"),
      1: click('[data-view="three-quarter"]'),
      2: click('[data-view="front"]'),
      3: click('[data-view="side"]'),
      4: click('[data-view="top"]'),
    };
    document.addEventListener("keydown", (event) => {
      const own = event.target.closest("select, button") && (event.key === " " || event.target.matches("select"));
      if (own || event.ctrlKey || event.metaKey || event.altKey || !actions[event.key]) return;
      event.preventDefault();
      actions[event.key](event);
    });
  }

  // What the colors of robots and lines mean, beside a ghost.
  function colorsOf({ ghost, motion: { series } }) {
    if (!ghost) return [];
    const command = series.some(({ command }) => command) ? [{ name: "command", color: "var(--quiet)" }] : [];
    return [{ name: ghost.beside, color: `hsl(${HUE} 62% var(--curve))` }, ghost, ...command];
  }

  function listNames(things) {
    element("legend").append(...things.map(({ name, color }) => {
      const item = document.createElement("li");
      const dot = document.createElement("i");
      dot.style.background = color;
      item.append(dot, name);
      return item;
    }));
  }

  function open() {
    const options = new URLSearchParams(location.hash.slice(1));
    const { viewer, content } = stage.open();
    if (!options.has("view") && !options.has("camera"))
      for (const [name, value] of Object.entries(content.view)) options.set(name, value);
    const motion = new Motion(viewer, content.motion);
    document.body.classList.toggle("still", motion.duration === 0);
    document.body.classList.toggle("bare", options.get("panel") === "0");
    listNames([...colorsOf(content), ...content.markers]);
    connectTimeline(motion);
    if (content.touches.length) connectTouches(viewer, motion, content.touches);
    if (content.notes.length) connectNotes(motion, content.notes);
    const showPlots = connectPlots(viewer, motion, content);
    showPlots(content.motion.series.length > 0 && (options.get("plots") ?? (innerWidth > 900 ? "1" : "0")) === "1");
    const subject = stage.subject(viewer, motion, content.markers);
    stage.layFloor(viewer, subject);
    const look = connectCamera(viewer, subject);
    connectKeys(motion);
    look(stage.VIEWS[options.get("view")] ? options.get("view") : "three-quarter");
    const camera = stage.cameraOf(options);
    if (camera) stage.stand(viewer, camera);
    motion.seek(Number(options.get("t") ?? motion.start) || motion.start);
    if (options.get("play") === "1") motion.play();
    window.pepperKin = {
      seek: (time) => motion.seek(time),
      play: () => motion.play(),
      pause: () => motion.pause(),
      get duration() { return motion.duration; },
      get time() { return motion.time; },
      get playing() { return motion.playing; },
      viewer,
    };
  }

  try {
    open();
  } catch (error) {
    fail(error);
    throw error;
  }
})();
