"use strict";
// The picture: draws what the server sends, and puts every body where the newest poses say.
class LiveScene {
  // Layers that are seen through the shell, in the order in which they are drawn.
  static SEEN_THROUGH = ["inertia", "zero_moment_point", "frames", "center_of_mass"];
  static GLASS = ["capsules", "spheres"];

  constructor(viewer, quality, robot) {
    this.viewer = viewer;
    this.robotRoot = robot.roots.robot;
    this.looks = robot.looks;
    this.looksShown = true;
    this.bodies = [];
    this.poses = null;
    this.stamp = 0;
    this.held = new Map(); // bodies that somebody drags here and now: they follow the pointer, not the server
    this.stale = true;
    this.drawnListeners = [];
    this.frames = 0;
    const render = viewer.render.bind(viewer);
    viewer.render = () => {
      this.arrange();
      quality.before();
      this.chooseLooks(quality.coarse);
      render();
      quality.after();
      this.frames += 1;
      this.drawnListeners.forEach((listener) => listener(this.stamp));
    };
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

  pose(values, stamp) {
    this.poses = values;
    this.stamp = stamp;
    this.viewer.set_dirty();
  }

  // Where a body is, in the robot's axes.
  place(name) {
    const index = this.bodies.indexOf(name);
    if (this.held.has(name)) return this.held.get(name);
    return this.poses && index >= 0 ? Array.from(this.poses.slice(7 * index, 7 * index + 3)) : null;
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
  }

  // Show the looks fine or coarse, where they are shown at all.
  chooseLooks(coarse) {
    const { fine, coarse: rough } = this.looks;
    const object = (layer) => this.viewer.scene_tree.find([...this.robotRoot, layer]).object;
    object(fine).visible = this.looksShown && !coarse;
    object(rough).visible = this.looksShown && coarse;
  }

  // Look up the objects that move with each body: one in every layer that draws something of it.
  find() {
    this.stale = false;
    const parts = new Map(this.bodies.map((name) => [name, []]));
    const collect = (node) => {
      for (const [name, child] of Object.entries(node.children)) {
        if (name !== "links") collect(child);
        else for (const [body, part] of Object.entries(child.children)) parts.get(body)?.push(part.object);
      }
    };
    const robot = this.viewer.scene_tree.find(this.robotRoot);
    collect(robot);
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
    // Both sides of glass would be drawn one after the other, at twice the cost; of coarse looks one is enough.
    [...LiveScene.SEEN_THROUGH, ...LiveScene.GLASS, this.looks.coarse].forEach((layer) => {
      robot.children[layer]?.object.traverse((object) => {
        if (object.material) object.material.side = MeshCat.THREE.FrontSide;
      });
    });
  }

  // Corners of what layers draw, in three.js' world axes, for the camera.
  corners(...layers) {
    this.arrange();
    this.viewer.scene.updateMatrixWorld(true);
    return layers.flatMap((layer) => stage.corners(this.viewer.scene_tree.find([...this.robotRoot, layer]).object));
  }
}
