"use strict";
// The moving picture where the processor has to draw it.  There each corner, each pixel and each call of the
// graphics library costs: so everything goes into three meshes (solid, glass, and what is seen through the
// shell), each with one call, whose corners a short program places by the bodies' poses and lights.
class Sketch {
  static PASSES = ["solid", "glass", "through"];

  constructor(viewer) {
    this.viewer = viewer;
    this.cutout = new Cutout(viewer);
    this.backdrop = new Backdrop(viewer, this.cutout);
    this.scene = this.backdrop.scene;
    this.meshes = [];
    this.bodies = 0;
  }

  // Whether the graphics library takes that many poses at once; each is two vectors of four numbers.
  static fits(renderer, bodies) {
    const gl = renderer.getContext();
    return 2 * (bodies + 1) + 32 <= gl.getParameter(gl.MAX_VERTEX_UNIFORM_VECTORS);
  }

  // Take new content.  pieces: for each pass a list of { mesh, body, root }; the body is the number of the pose
  // that the mesh moves with, -1 for none, and the root the object that this pose moves.
  fill(pieces, bodies) {
    const THREE = MeshCat.THREE;
    this.meshes.forEach((mesh) => {
      this.scene.remove(mesh);
      mesh.geometry.dispose();
      mesh.material.dispose();
    });
    this.bodies = bodies;
    this.places = Array.from({ length: 2 * (bodies + 1) }, (_, k) => new THREE.Vector4(0, 0, 0, k % 2));
    const uniforms = { places: { value: this.places }, ...this.lights() };
    this.meshes = Sketch.PASSES.flatMap((pass, order) => {
      if (!pieces[pass].length) return [];
      const mesh = new THREE.Mesh(Sketch.geometry(pieces[pass]), Sketch.material(pass, uniforms, bodies + 1));
      mesh.frustumCulled = mesh.matrixAutoUpdate = false;
      mesh.matrix.copy(this.viewer.scene_tree.object.matrixWorld); // from the robot's axes
      mesh.renderOrder = order;
      this.scene.add(mesh);
      return [mesh];
    });
    this.boxes = Sketch.boxes(this.meshes.map((mesh) => mesh.geometry), bodies + 1);
    this.corners = new Float32Array(24 * this.boxes.length);
  }

  // The box around all that moves with each body, in its own axes: the body's number, its middle and half its size.
  static boxes(geometries, count) {
    const boxes = Array.from({ length: count }, () => new MeshCat.THREE.Box3());
    const corner = new MeshCat.THREE.Vector3();
    for (const { attributes } of geometries) {
      const { position, body } = attributes;
      for (let i = 0; i < position.count; i++) boxes[body.array[i]].expandByPoint(corner.fromBufferAttribute(position, i));
    }
    return boxes.flatMap((box, number) => {
      if (box.isEmpty()) return [];
      const { x, y, z } = box.getSize(new MeshCat.THREE.Vector3()).multiplyScalar(0.5);
      const sides = [[x, 0, 0], [0, y, 0], [0, 0, z]].map((side) => new MeshCat.THREE.Vector3(...side));
      return [{ number, middle: box.getCenter(new MeshCat.THREE.Vector3()), sides }];
    });
  }

  // Corners of these boxes where the bodies are now, in the robot's axes: x, y, z in turn.
  reach() {
    const turn = new MeshCat.THREE.Quaternion(), middle = new MeshCat.THREE.Vector3(), corner = new MeshCat.THREE.Vector3();
    let at = 0;
    for (const box of this.boxes) {
      turn.copy(this.places[2 * box.number + 1]);
      middle.copy(box.middle).applyQuaternion(turn).add(this.places[2 * box.number]);
      const sides = box.sides.map((side) => side.clone().applyQuaternion(turn));
      for (let signs = 0; signs < 8; signs++, at += 3) {
        corner.copy(middle);
        sides.forEach((side, axis) => corner.addScaledVector(side, signs & (1 << axis) ? 1 : -1));
        corner.toArray(this.corners, at);
      }
    }
    return this.corners;
  }

  // Put body k where values say: x, y, z and the quaternion.
  place(k, x, y, z, qx, qy, qz, qw) {
    this.places[2 * k + 2].set(x, y, z, 0);
    this.places[2 * k + 3].set(qx, qy, qz, qw);
  }

  // Draw the bodies where they are now.  render: draws the viewer's scene.
  draw(render) {
    const { viewer, scene, cutout } = this;
    viewer.controls.update();
    viewer.camera.updateMatrixWorld();
    if (this.backdrop.prepare()) cutout.fit(this.reach(), this.projection());
    else cutout.open();
    const whole = viewer.scene;
    viewer.scene = scene;
    cutout.through(render);
    viewer.scene = whole;
  }

  // From the robot's axes to the screen.
  projection() {
    const { camera, scene_tree } = this.viewer;
    const matrix = new MeshCat.THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    return matrix.multiply(scene_tree.object.matrixWorld);
  }

  // The lights of the stage, in the robot's axes.
  lights() {
    const THREE = MeshCat.THREE;
    const part = (name) => this.viewer.scene_tree.find(["Stage", name, "<object>"]).object;
    const [sky, key, rim] = ["sky", "key", "rim"].map(part);
    const shine = (light, color = light.color) => ({ value: new THREE.Color().copy(color).multiplyScalar(light.intensity) });
    const way = (light) => { // a light may follow the robot: its way stays the same
      const { x = 0, z = 0 } = light.target?.position ?? {};
      return { value: light.position.clone().sub(new THREE.Vector3(x, -z, 0)).normalize() };
    };
    return {
      sky: shine(sky), ground: shine(sky, sky.groundColor), key: shine(key), keyWay: way(key), rim: shine(rim), rimWay: way(rim),
    };
  }

  static material(pass, uniforms, count) {
    const solid = pass === "solid";
    return new MeshCat.THREE.ShaderMaterial({
      uniforms,
      defines: { COUNT: 2 * count },
      transparent: !solid,
      depthTest: pass !== "through",
      depthWrite: pass !== "through",
      vertexShader: `
        attribute vec4 tint;
        attribute float body;
        uniform vec4 places[COUNT];
        uniform vec3 sky, ground, key, keyWay, rim, rimWay;
        varying vec4 seen;
        vec3 turned(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
        void main() {
          int at = 2 * int(body);
          vec4 turn = places[at + 1];
          vec3 up = turned(turn, normal);
          vec3 light = mix(ground, sky, 0.5 * up.z + 0.5) + key * max(dot(up, keyWay), 0.0) + rim * max(dot(up, rimWay), 0.0);
          seen = vec4(tint.rgb * light, tint.a);
          gl_Position = projectionMatrix * (modelViewMatrix * vec4(turned(turn, position) + places[at].xyz, 1.0));
        }`,
      fragmentShader: `
        varying vec4 seen;
        void main() { gl_FragColor = seen; }`,
    });
  }

  static geometry(pieces) {
    const THREE = MeshCat.THREE;
    const counts = pieces.map(({ mesh }) => mesh.geometry.attributes.position.count);
    const total = counts.reduce((sum, count) => sum + count, 0);
    const position = new Float32Array(3 * total), normal = new Float32Array(3 * total);
    const tint = new Uint8Array(4 * total), body = new Float32Array(total), index = [];
    const vector = new THREE.Vector3(), pose = new THREE.Matrix4(), turn = new THREE.Matrix3();
    let start = 0;
    pieces.forEach(({ mesh, body: number, root }, k) => {
      pose.copy(root.matrixWorld).invert().multiply(mesh.matrixWorld);
      turn.getNormalMatrix(pose);
      const { attributes, index: faces } = mesh.geometry;
      const { color, opacity, transparent } = mesh.material;
      const shade = [color.r, color.g, color.b, transparent ? opacity : 1].map((part) => Math.round(255 * part));
      for (let i = 0; i < counts[k]; i++) {
        vector.fromBufferAttribute(attributes.position, i).applyMatrix4(pose).toArray(position, 3 * (start + i));
        vector.fromBufferAttribute(attributes.normal, i).applyMatrix3(turn).normalize().toArray(normal, 3 * (start + i));
        tint.set(shade, 4 * (start + i));
        body[start + i] = number + 1;
      }
      const corners = faces ? faces.count : counts[k];
      for (let i = 0; i < corners; i++) index.push(start + (faces ? faces.array[i] : i));
      start += counts[k];
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(normal, 3));
    geometry.setAttribute("tint", new THREE.BufferAttribute(tint, 4, true));
    geometry.setAttribute("body", new THREE.BufferAttribute(body, 1));
    geometry.setIndex(index);
    return geometry;
  }
}

// Sky and floor: while the camera rests they are a picture that is drawn once and lies under the sketch, which
// then is clear where nothing moves: even a mere copy of so many pixels would take as long as half the robot.
class Backdrop {
  constructor(viewer, cutout) {
    const THREE = MeshCat.THREE;
    this.viewer = viewer;
    this.cutout = cutout;
    const grid = viewer.scene_tree.find(["Stage", "grid", "<object>"]).object;
    this.grid = new THREE.Mesh(grid.geometry, grid.material);
    this.grid.matrixAutoUpdate = false;
    this.grid.matrix.copy(viewer.scene_tree.object.matrixWorld);
    this.grid.renderOrder = -1;
    this.scene = new THREE.Scene();
    this.scene.add(this.grid);
    this.picture = make("canvas", { className: "backdrop" });
    viewer.renderer.domElement.before(this.picture);
    this.seen = this.kept = "";
  }

  // To be called before each frame of the scene: once the camera rests, take its sky and floor for the picture.
  // Returns whether it rests.
  prepare() {
    const { renderer, camera, scene } = this.viewer;
    const { width, height } = this.cutout;
    const ratio = renderer.getPixelRatio();
    const seen = [stage.isDark(), width, height, ratio, ...camera.matrixWorld.elements, ...camera.projectionMatrix.elements].join();
    const rests = seen === this.seen;
    this.seen = seen;
    if (rests && seen !== this.kept) {
      this.kept = seen;
      this.cutout.open();
      this.take(scene.background);
    }
    this.show(rests ? null : scene.background);
    return rests;
  }

  take(background) {
    const { renderer, camera } = this.viewer;
    const { domElement } = renderer;
    const others = this.scene.children.filter((child) => child !== this.grid);
    this.show(background);
    others.forEach((child) => (child.visible = false));
    renderer.render(this.scene, camera);
    others.forEach((child) => (child.visible = true));
    Object.assign(this.picture, { width: domElement.width, height: domElement.height });
    this.picture.getContext("2d", { alpha: false }).drawImage(domElement, 0, 0);
  }

  show(background) {
    this.scene.background = background;
    this.grid.visible = background !== null;
  }
}
