"use strict";
// The live page: one robot on a server, seen and moved by everybody who has the page open.
(() => {
  const element = (id) => document.getElementById(id);
  const view = element("view");
  const options = new URLSearchParams(location.hash.slice(1));
  let parts = null; // what is made of the server's first words
  let looked = null; // the view that the camera has, once it has one
  let own = stage.cameraOf(options); // a camera of one's own: nothing but its owner moves it

  function openViewer() {
    const { renderer, software } = Quality.makeRenderer();
    view.append(renderer.domElement);
    const viewer = new MeshCat.Viewer(view, true, renderer);
    // meshcat takes the window's size; here it is that of its own pane.
    const resize = viewer.set_3d_pane_size.bind(viewer);
    viewer.set_3d_pane_size = () => resize(view.clientWidth, view.clientHeight);
    new ResizeObserver(() => viewer.set_3d_pane_size()).observe(view);
    stage.furnish(viewer, () => {
      const height = view.clientHeight;
      const top = element("top").offsetHeight + 12;
      const bottom = Math.min(element("bottom").offsetHeight + 12, height / 3);
      const free = { width: view.clientWidth, height: Math.max(height - top - bottom, 50) };
      return { height, free, drop: (top - bottom) / 2 };
    });
    return { viewer, quality: new Quality(viewer, software) };
  }

  function open() {
    try {
      return openViewer();
    } catch (error) {
      element("failure").textContent = `This page cannot draw: ${error.message}. It needs a browser with WebGL.`;
      element("failure").hidden = false;
      throw error;
    }
  }

  const { viewer, quality } = open();
  const send = (command) => link.send(command);

  function look(name) {
    const points = parts.scene.subject(parts.way);
    if (!points.length) return;
    stage.layFloor(viewer, points);
    stage.look(viewer, points, name);
    looked = name;
  }

  // Look again when a target, the body or the way of a motion has left the picture.
  function lookAgain() {
    if (!looked || own || parts.drag.hold) return;
    const points = parts.scene.needed(parts.way);
    const outside = points.some((point) => {
      const { x, y, z } = point.project(viewer.camera);
      return Math.abs(x) > 1 || Math.abs(y) > 1 || z > 1;
    });
    if (outside) look(looked);
  }

  function handles(robot, scene, targets) {
    const obstacleName = (object) => {
      for (let part = object; part; part = part.parent) {
        if (part.parent?.name === robot.roots.obstacles[0]) return part.name;
      }
      return null;
    };
    return {
      targets: () => robot.targets.flatMap((name) => {
        const body = `@${name}`;
        const place = scene.place(body);
        if (!place) return [];
        return [{
          place,
          moved: (position) => {
            scene.held.set(body, position);
            viewer.set_dirty();
            targets.move(name, position);
          },
          dropped: () => scene.held.delete(body),
        }];
      }),
      obstacleRoot: () => viewer.scene_tree.find(robot.roots.obstacles).object,
      obstacle: (object) => {
        const path = obstacleName(object);
        const thing = parts.things.find(({ name }) => name.replaceAll("/", "_") === path);
        if (!thing) return null;
        return {
          place: thing.position,
          moved: (position) => send({ do: "change", name: thing.name, position }),
          dropped: () => undefined,
        };
      },
    };
  }

  function hello({ robot, session }) {
    const scene = parts?.scene ?? new LiveScene(viewer, quality, robot);
    scene.forget([robot.roots.robot, robot.roots.obstacles, ["markers"], ["ghost"]]);
    const targets = new TargetRows(robot, send);
    parts = {
      robot, session, scene, targets, things: [], way: null,
      joints: new Joints(robot, send), layers: new Layers(robot, send), obstacles: new ObstacleRows(robot, send),
      timeline: new Timeline(send), plots: new Plots(robot),
      drag: parts?.drag ?? new Drag(view, viewer, handles(robot, scene, targets)),
    };
    parts.drag.handles = handles(robot, scene, targets);
    element("offline").hidden = true;
  }

  // What each value of the state changes in the page.
  const show = {
    bodies: (names) => parts.scene.setBodies(names),
    q: (q) => parts.joints.update(q),
    show: (shown) => {
      parts.layers.update(shown);
      viewer.set_dirty();
    },
    targets: (targets) => {
      parts.targets.update(targets);
      parts.scene.wanted = Object.values(targets).filter(({ on }) => on).map(({ position }) => position);
      lookAgain();
    },
    follow: (on) => (element("follow").checked = on),
    obstacles: (things) => {
      parts.things = things;
      parts.obstacles.update(things);
    },
    motion: (motion) => {
      parts.timeline.setMotion(motion);
      parts.way = motion?.way ?? null;
      lookAgain();
      parts.plots.motion = motion;
      parts.plots.draw();
    },
    play: (state) => {
      parts.timeline.update(state);
      parts.plots.time = state?.time ?? 0;
      parts.plots.draw();
    },
    mode: (mode) => {
      parts.plots.inMotion = mode === "motion";
      element("go").ariaPressed = String(mode === "live");
    },
    live: (sample) => parts.plots.add(sample),
    alerts: (alerts) => showAlerts(alerts),
    touching: (touching) => parts.scene.setTouching(touching),
    message: (said) => messageLine.update({ said }),
    busy: (busy) => {
      element("plan").disabled = busy !== null;
      messageLine.update({ busy });
    },
  };

  const receiver = {
    hello,
    history: ({ samples }) => parts.plots.setHistory(samples),
    state: ({ values }) => {
      for (const key of Object.keys(show)) if (key in values) show[key](values[key]);
      window.pepperKin.values = { ...window.pepperKin.values, ...values };
    },
    refused: ({ text }) => messageLine.update({ said: { text, kind: "bad" } }),
    draw: (bytes) => parts.scene.draw(bytes),
    pose: (values, stamp) => {
      parts.scene.pose(values, stamp);
      if (looked) return;
      look(stage.VIEWS[options.get("view")] ? options.get("view") : "three-quarter");
      if (own) stage.stand(viewer, own);
    },
    offline: () => (element("offline").hidden = false),
  };

  document.querySelectorAll("[data-view]").forEach((button) => {
    button.addEventListener("click", () => {
      if (!parts) return;
      own = null;
      stage.forgetCamera(button.dataset.view);
      look(button.dataset.view);
    });
  });
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => parts?.plots.draw());
  stage.keepCamera(viewer, () => (own = stage.standing(viewer)));
  setInterval(() => parts?.scene.poses && lookAgain(), 500);
  window.pepperKin = {
    viewer,
    quality,
    values: {},
    get parts() { return parts; },
    get connected() { return link.connected && parts !== null; },
  };
  const link = new Link(receiver);
})();
