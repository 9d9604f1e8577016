"use strict";
// The picture: draws what the server sends, and puts every body where the newest poses say.
class LiveScene {
  // Layers that are seen through the shell, in the order in which they are drawn.
  static SEEN_THROUGH = ["inertia", "zero_moment_point", "frames", "center_of_mass"];
  static GLASS = ["capsules", "spheres"];
  static BODIES = ["visual", "capsules", "spheres"]; // layers that are red where they touch

  constructor(viewer, quality, robot) {
    this.viewer = viewer;
    this.robotRoot = robot.roots.robot;
    this.sketches = robot.sketches;
    this.otherRoots = [robot.roots.obstacles, ["markers"], ["ghost"]];
    this.bodies = [];
    this.poses = null;
    this.stamp = 0;
    this.touching = { bodies: [], objects: [] };
    this.wanted = []; // places of the targets that are set
    this.held = new Map(); // bodies that somebody drags here and now: they follow the pointer, not the server
    this.stale = true;
    this.drawnListeners = [];
    this.frames = 0;
    this.quality = quality;
    this.sketch = quality.software ? new Sketch(viewer) : null;
    this.ahead = false; // whether a frame was drawn since the screen showed the last one
    this.turn = new MessageChannel();
    this.turn.port1.onmessage = () => this.drawAhead();
    this.render = viewer.render.bind(viewer);
    viewer.render = () => this.drawFrame();
    viewer.animate = () => {
      requestAnimationFrame(() => viewer.animate());
      viewer.animator.update();
      if (viewer.needs_render && !this.ahead) viewer.render();
      else if (viewer.needs_render) this.turn.port2.postMessage(null);
      this.ahead = false;
    };
  }

  drawFrame() {
    // Until poses come there is nothing to see but links piled up at the origin.
    if (!this.poses) {
      this.viewer.needs_render = false;
      return;
    }
    if (this.stale) this.find();
    this.quality.before();
    if (this.quality.sketched && Sketch.fits(this.viewer.renderer, this.bodies.length)) this.drawSketch();
    else this.drawFinely();
    this.quality.after();
    this.frames += 1;
    this.drawnListeners.forEach((listener) => listener(this.stamp));
  }

  forget(roots) {
    roots.forEach((root) => this.viewer.delete_path(root));
    this.stale = true;
    this.poses = null;
  }

  draw(bytes) {
    this.viewer.handle_command_bytearray(bytes);
    this.stale = true;
  }

  setBodies(names) {
    this.bodies = names.map((name) => name.replaceAll("/", "_"));
    this.stale = true;
  }

  // What touches something is red: bodies of the robot by their pose's name, objects by their own.
  setTouching(touching) {
    this.touching = touching;
    this.stale = true;
    this.viewer.set_dirty();
  }

  // A sketch takes the processor's time, not the screen's: it begins as soon as all poses that wait are taken, not
  // with the screen's next frame, but only one for each of those.
  pose(values, stamp) {
    this.poses = values;
    this.stamp = stamp;
    this.viewer.set_dirty();
    this.turn.port2.postMessage(null);
  }

  drawAhead() {
    if (!this.quality.sketched || this.ahead || document.hidden || !this.viewer.needs_render) return;
    this.ahead = true;
    this.viewer.render();
  }

  // Where a body is, in the robot's axes.
  place(name) {
    const index = this.bodies.indexOf(name);
    if (this.held.has(name)) return this.held.get(name);
    return this.poses && index >= 0 ? Array.from(this.poses.slice(7 * index, 7 * index + 3)) : null;
  }

  drawFinely() {
    this.sketch?.cutout.open();
    this.arrange();
    this.render();
  }

  drawSketch() {
    const { sketch } = this;
    if (!this.sketched) this.fillSketch();
    if (this.poses?.length === 7 * this.bodies.length) {
      const values = this.poses;
      for (let k = 0, at = 0; k < this.bodies.length; k++, at += 7) {
        const [x, y, z] = this.held.get(this.bodies[k]) ?? [values[at], values[at + 1], values[at + 2]];
        sketch.place(k, x, y, z, values[at + 3], values[at + 4], values[at + 5], values[at + 6]);
      }
    }
    sketch.draw(this.render);
  }

  // Gather what is shown now for the sketch: coarse stand-ins where there are any.
  fillSketch() {
    this.sketched = true;
    const pieces = { solid: [], glass: [], through: [] };
    const axes = this.viewer.scene_tree.object;
    axes.updateMatrixWorld(true);
    const gather = (node, pass, body, root) => {
      for (const [name, child] of Object.entries(node.children)) {
        const { object } = child;
        if (!object.visible) continue;
        if (name === "<object>") {
          if (!object.geometry) continue;
          const kind = pass ?? (object.material.transparent && object.material.opacity < 1 ? "glass" : "solid");
          pieces[kind].push({ mesh: object, body, root });
        } else if (node.object.name === "links") {
          const number = this.bodies.indexOf(name);
          gather(child, pass, number, number < 0 ? axes : object);
        } else gather(child, pass, body, root);
      }
    };
    const tree = (path) => this.viewer.scene_tree.find(path);
    const { children } = tree(this.robotRoot);
    const { [this.sketches]: sketches, ...layers } = children;
    const ordered = [...Object.keys(layers).filter((name) => !LiveScene.SEEN_THROUGH.includes(name)), ...LiveScene.SEEN_THROUGH];
    for (const layer of ordered) {
      if (!layers[layer]?.object.visible) continue;
      const pass = LiveScene.SEEN_THROUGH.includes(layer) ? "through" : null;
      gather(sketches?.children[layer] ?? layers[layer], pass, -1, axes);
    }
    for (const root of this.otherRoots) if (tree(root).object.visible) gather(tree(root), null, -1, axes);
    this.sketch.fill(pieces, this.bodies.length);
  }

  arrange() {
    if (this.stale) this.find();
    if (!this.poses || this.poses.length !== 7 * this.bodies.length) return;
    const values = this.poses;
    this.parts.forEach((objects, index) => {
      const at = 7 * index;
      const held = this.held.get(this.bodies[index]);
      for (const object of objects) {
        if (held) object.position.set(...held);
        else object.position.set(values[at], values[at + 1], values[at + 2]);
        object.quaternion.set(values[at + 3], values[at + 4], values[at + 5], values[at + 6]);
      }
    });
    const count = this.bodies.filter((name) => !name.startsWith("@")).length;
    let [x, y] = [0, 0];
    for (let k = 0; k < count; k++) [x, y] = [x + values[7 * k] / count, y + values[7 * k + 1] / count];
    stage.lightUp(this.viewer, x, y);
  }

  // Look up the objects that move with each body: one in every layer that draws something of it.
  find() {
    this.stale = this.sketched = false;
    const parts = new Map(this.bodies.map((name) => [name, []]));
    const red = new Set(this.touching.bodies.map((name) => name.replaceAll("/", "_")));
    const collect = (node) => {
      for (const [name, child] of Object.entries(node.children)) {
        if (name !== "links") collect(child);
        else for (const [body, part] of Object.entries(child.children)) parts.get(body)?.push(part.object);
      }
    };
    const tint = (node) => {
      for (const [name, child] of Object.entries(node.children)) {
        if (name === "links") Object.entries(child.children).forEach(([body, part]) => stage.tint(part.object, red.has(body)));
        else if (LiveScene.BODIES.includes(name)) tint(child);
      }
    };
    const robot = this.viewer.scene_tree.find(this.robotRoot);
    collect(robot);
    for (const node of [robot, robot.children[this.sketches]]) if (node) tint(node);
    this.tintObjects(robot.children.held);
    this.parts = [...parts.values()];
    stage.castShadows(this.viewer);
    robot.children.targets?.object.traverse((object) => (object.castShadow = false));
    LiveScene.SEEN_THROUGH.forEach((layer, order) => {
      robot.children[layer]?.object.traverse((object) => {
        if (!object.material) return;
        object.material.depthTest = false;
        object.material.transparent = true;
        object.renderOrder = 10 + order;
        object.castShadow = object.receiveShadow = false;
      });
    });
    // Both sides of glass would be drawn one after the other, at twice the cost.
    [...LiveScene.SEEN_THROUGH, ...LiveScene.GLASS].forEach((layer) => {
      robot.children[layer]?.object.traverse((object) => {
        if (object.material) object.material.side = MeshCat.THREE.FrontSide;
      });
    });
  }

  tintObjects(held) {
    const red = new Set(this.touching.objects.map((name) => name.replaceAll("/", "_")));
    const world = this.viewer.scene_tree.find(this.otherRoots[0]);
    for (const node of [world, held]) {
      for (const [name, child] of Object.entries(node?.children ?? {})) stage.tint(child.object, red.has(name));
    }
  }

  // Points that the picture must have, in three.js' world axes: where the body is, the targets that it is to reach,
  // and the box around the way of a motion (two opposite corners), if there is one.
  needed(way) {
    const values = this.poses ?? [];
    const bodies = this.bodies.map((name, k) => (name.startsWith("@") ? null : values.slice(7 * k, 7 * k + 3)));
    const points = [...bodies.filter((place) => place?.length === 3), ...this.wanted];
    if (way) {
      const [[x, y, z], [X, Y, Z]] = way;
      for (const a of [x, X]) for (const b of [y, Y]) for (const c of [z, Z]) points.push([a, b, c]);
    }
    return points.map(([x, y, z]) => new MeshCat.THREE.Vector3(x, z, -y));
  }

  // Points that the camera should see: what must be seen, all of the body, its targets, and what stands wholly near.
  subject(way) {
    this.arrange();
    this.viewer.scene.updateMatrixWorld(true);
    const below = (path) => stage.corners(this.viewer.scene_tree.find(path).object);
    const points = [
      ...this.needed(way), ...this.wanted.flatMap((place) => stage.around(place)),
      ...["visual", "targets"].flatMap((layer) => below([...this.robotRoot, layer])), ...below(["markers"]),
    ];
    const near = new MeshCat.THREE.Box3().setFromPoints(points).expandByScalar(1);
    for (const object of this.viewer.scene_tree.find(this.otherRoots[0]).object.children) {
      const around = stage.corners(object);
      if (around.every((corner) => near.containsPoint(corner))) points.push(...around);
    }
    return points;
  }
}
