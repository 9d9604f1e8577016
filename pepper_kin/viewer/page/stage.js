"use strict";
// The stage: meshcat's viewer with the scene of this page, lights, floor and camera.  World axes: x forward,
// y left, z up; three.js itself has y up, and meshcat turns its scene so that everything below is z up.
const stage = (() => {
  const THREE = MeshCat.THREE;
  const TYPED_ARRAYS = { Uint8Array, Uint16Array, Int32Array, Uint32Array, Float32Array, Float64Array };
  const FIELD_OF_VIEW = 32; // degrees, vertical: little distortion, like a photograph from a few meters
  const KEY = [2.2, 1.6, 4.2]; // where the light stands that throws shadows, from what it shines on [m]
  const REACH = 5; // how far the floor's lines are seen [m]
  const SKIES = {
    light: { top: "#cfdae6", horizon: "#eef2f6", ink: "#475c75", shade: 0.2 },
    dark: { top: "#10151c", horizon: "#252d37", ink: "#a9b9cb", shade: 0.5 },
  };
  const CONTACT = new THREE.Color("#e01b10"); // of what touches
  const VIEWS = { // azimuth from the front towards the robot's left, elevation, in degrees
    "three-quarter": [38, 14],
    front: [0, 6],
    side: [90, 6],
    top: [0, 89.9],
  };

  function decode(base64) {
    const text = atob(base64);
    const bytes = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
    return bytes.buffer;
  }

  // Replace each stand-in {$buffer, $type} by a typed array over that buffer.
  function revive(value, buffers) {
    if (Array.isArray(value)) return value.map((item) => revive(item, buffers));
    if (value === null || typeof value !== "object") return value;
    if (value.$buffer !== undefined) return new TYPED_ARRAYS[value.$type](buffers[value.$buffer]);
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, revive(item, buffers)]));
  }

  function readContent() {
    const raw = JSON.parse(document.getElementById("content").textContent);
    const buffers = raw.buffers.map(decode);
    delete raw.buffers;
    return revive(raw, buffers);
  }

  function addLights(viewer) {
    viewer.set_property(["Lights"], "visible", false); // meshcat's own set lights white shells flat
    viewer.set_property(["Axes"], "visible", false);
    viewer.renderer.shadowMap.type = THREE.PCFShadowMap; // near as soft as the default, at half its cost
    const sky = new THREE.HemisphereLight(0xffffff, 0xcbd3dc, 0.66);
    sky.position.set(0, 0, 1); // in the scene's own axes
    const key = new THREE.DirectionalLight(0xfff6ea, 0.38);
    key.position.set(...KEY);
    key.castShadow = true;
    key.shadow.mapSize.set(1024, 1024);
    Object.assign(key.shadow.camera, { left: -2, right: 2, top: 2, bottom: -2, near: 1, far: 9 });
    key.shadow.radius = 2;
    key.shadow.normalBias = 0.012;
    const rim = new THREE.DirectionalLight(0xdfeaff, 0.16);
    rim.position.set(-2, -3, 2);
    viewer.set_object(["Stage", "sky"], sky);
    viewer.set_object(["Stage", "key"], key);
    viewer.set_object(["Stage", "rim"], rim);
  }

  // Lines every half meter, finer ones every tenth, that fade out with the distance from the origin.
  function floorGrid() {
    const material = new THREE.ShaderMaterial({
      uniforms: { reach: { value: REACH }, ink: { value: new THREE.Color() } },
      transparent: true,
      depthWrite: false,
      side: THREE.DoubleSide,
      extensions: { derivatives: true },
      vertexShader: `
        varying vec2 place;
        void main() {
          place = position.xy;
          gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
        }`,
      fragmentShader: `
        uniform float reach;
        uniform vec3 ink;
        varying vec2 place;
        float lines(float spacing, float width) {
          vec2 cell = place / spacing;
          vec2 pixel = max(fwidth(cell), vec2(1e-6));
          vec2 away = abs(fract(cell - 0.5) - 0.5) / pixel;
          float coverage = 1.0 - min(min(away.x, away.y) / width, 1.0);
          return coverage * (1.0 - smoothstep(0.2, 0.6, max(pixel.x, pixel.y)));
        }
        void main() {
          float fade = 1.0 - smoothstep(0.2 * reach, reach, length(place));
          float strength = max(0.30 * lines(0.5, 1.2), 0.12 * lines(0.1, 1.0));
          gl_FragColor = vec4(ink, strength * fade);
        }`,
    });
    return new THREE.Mesh(new THREE.PlaneGeometry(2.4 * REACH, 2.4 * REACH), material);
  }

  function addFloor(viewer) {
    viewer.set_property(["Grid"], "visible", false);
    const grid = floorGrid();
    grid.renderOrder = -2;
    const shade = new THREE.Mesh(new THREE.PlaneGeometry(12, 12), new THREE.ShadowMaterial());
    shade.receiveShadow = true;
    shade.material.depthWrite = false;
    shade.renderOrder = -1;
    viewer.set_object(["Stage", "grid"], grid);
    viewer.set_object(["Stage", "shade"], shade);
    paintSky(viewer);
    darkness.addEventListener("change", () => paintSky(viewer));
  }

  // Whether the picture is dark: as the visitor's other pages; pictures and films, which have no panel, never are.
  const darkness = window.matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => darkness.matches && !/(^|[#&])panel=0/.test(location.hash);

  function paintSky(viewer) {
    const { top, horizon, ink, shade } = SKIES[isDark() ? "dark" : "light"];
    const color = (hex) => new THREE.Color(hex).toArray();
    viewer.set_property(["Background"], "top_color", color(top));
    viewer.set_property(["Background"], "bottom_color", color(horizon));
    const part = (name) => viewer.scene_tree.find(["Stage", name, "<object>"]).object.material;
    part("grid").uniforms.ink.value.set(ink);
    part("shade").opacity = shade;
    viewer.set_dirty();
  }

  // Lay the floor below everything that will be seen: points in three.js' world axes.
  function layFloor(viewer, points) {
    const box = new THREE.Box3().setFromPoints(points);
    const [middle, size] = [box.getCenter(new THREE.Vector3()), box.getSize(new THREE.Vector3())];
    const reach = Math.max(REACH, Math.hypot(size.x, size.z) / 2 + REACH / 2);
    for (const name of ["grid", "shade"]) {
      const mesh = viewer.scene_tree.find(["Stage", name, "<object>"]).object;
      // By whole cells, so that the lines stay where they are in the world.
      mesh.position.set(0.5 * Math.round(2 * middle.x), 0.5 * Math.round(-2 * middle.z), 0);
      if (reach === REACH) mesh.position.set(0, 0, 0);
      mesh.geometry.dispose();
      mesh.geometry = new THREE.PlaneGeometry(2.4 * reach, 2.4 * reach);
      mesh.updateMatrixWorld(true);
    }
    viewer.scene_tree.find(["Stage", "grid", "<object>"]).object.material.uniforms.reach.value = reach;
    viewer.set_dirty();
  }

  // Let the light that throws shadows shine on what is at x, y of the world [m]: a base may drive far.
  function lightUp(viewer, x, y) {
    const key = viewer.scene_tree.find(["Stage", "key", "<object>"]).object;
    const [east, north] = [Math.round(x), Math.round(y)]; // by whole meters: shadows do not crawl
    if (key.target.position.x === east && key.target.position.z === -north) return;
    key.position.set(KEY[0] + east, KEY[1] + north, KEY[2]);
    key.target.position.set(east, 0, -north);
    key.target.updateMatrixWorld(true);
  }

  // Stand at a place of one's own: position and target in the world's axes, six numbers.
  function stand(viewer, [px, py, pz, tx, ty, tz]) {
    viewer.camera.fov = FIELD_OF_VIEW;
    viewer.camera.near = 0.05;
    viewer.controls.target.set(tx, tz, -ty);
    viewer.camera.position.set(px, pz, -py);
    viewer.controls.update();
    viewer.camera.updateProjectionMatrix();
    viewer.set_dirty();
  }

  // The six numbers of where the camera is, with millimeters.
  function standing(viewer) {
    const [p, t] = [viewer.camera.position, viewer.controls.target];
    return [p.x, -p.z, p.y, t.x, -t.z, t.y].map((x) => Number(x.toFixed(3)));
  }

  // A camera from the address' options, or null.
  function cameraOf(options) {
    const numbers = (options.get("camera") ?? "").split(",").map(Number);
    return numbers.length === 6 && numbers.every(Number.isFinite) ? numbers : null;
  }

  // Keep the camera of somebody who has turned it in the page's address: it is there again after a reload.
  function keepCamera(viewer, onMoved) {
    viewer.controls.addEventListener("end", () => {
      const options = new URLSearchParams(location.hash.slice(1));
      options.delete("view");
      options.set("camera", standing(viewer).join(","));
      history.replaceState(null, "", `#${options.toString().replaceAll("%2C", ",")}`);
      onMoved?.();
    });
  }

  // A named view takes the place of a camera that the address has.
  function forgetCamera(name) {
    const options = new URLSearchParams(location.hash.slice(1));
    options.delete("camera");
    options.set("view", name);
    history.replaceState(null, "", `#${options}`);
  }

  // Stand where the points fill the part of the window that the panels leave free.
  function look(viewer, points, name) {
    const [azimuth, elevation] = VIEWS[name].map(THREE.MathUtils.degToRad);
    const backward = new THREE.Vector3( // three.js axes: (x, z, -y)
      Math.cos(elevation) * Math.cos(azimuth),
      Math.sin(elevation),
      -Math.cos(elevation) * Math.sin(azimuth),
    );
    const right = new THREE.Vector3(0, 1, 0).cross(backward).normalize();
    const axes = [right, backward.clone().cross(right), backward];
    const seen = points.map((point) => axes.map((axis) => point.dot(axis)));
    const middle = [0, 1, 2].map((k) => {
      const values = seen.map((coordinates) => coordinates[k]);
      return (Math.min(...values) + Math.max(...values)) / 2;
    });
    const { height, free, drop = 0 } = room();
    const slope = Math.tan(THREE.MathUtils.degToRad(FIELD_OF_VIEW / 2)) / height;
    const distances = seen.map(([x, y, depth]) => depth - middle[2] + Math.max(
      Math.abs(x - middle[0]) / (slope * free.width), Math.abs(y - middle[1]) / (slope * free.height),
    ));
    const target = new THREE.Vector3();
    axes.forEach((axis, k) => target.addScaledVector(axis, middle[k]));
    const distance = 1.08 * Math.max(0.3, ...distances);
    target.addScaledVector(axes[1], 2 * slope * distance * drop);
    viewer.camera.fov = FIELD_OF_VIEW;
    viewer.camera.near = 0.05;
    viewer.controls.target.copy(target);
    viewer.camera.position.copy(target).addScaledVector(backward, distance);
    viewer.controls.update();
    viewer.set_dirty();
  }

  // How high the picture is, and which part of it nothing covers [pixel]; a page may put its own here.
  let room = () => ({ height: window.innerHeight, free: freeArea() });

  function freeArea() {
    const rectangle = { left: 0, right: window.innerWidth, top: 0, bottom: window.innerHeight };
    const bounds = (id) => document.getElementById(id).getBoundingClientRect();
    const [top, panel, plots] = ["top", "panel", "plots"].map(bounds);
    if (top.height) rectangle.top = Math.min(top.bottom, window.innerHeight / 4);
    if (panel.height) rectangle.bottom = Math.max(panel.top, window.innerHeight / 2);
    if (plots.height && plots.width < window.innerWidth / 2) rectangle.right = plots.left;
    else if (plots.height) rectangle.bottom = Math.max(plots.top, window.innerHeight / 3);
    rectangle.width = rectangle.right - rectangle.left;
    rectangle.height = rectangle.bottom - rectangle.top;
    return rectangle;
  }

  // Slide the picture so that the camera's target sits in the middle of the free area.
  function fitWindow(viewer) {
    viewer.set_3d_pane_size(window.innerWidth, window.innerHeight);
    const free = freeArea();
    viewer.camera.setViewOffset(
      window.innerWidth, window.innerHeight,
      (window.innerWidth - free.left - free.right) / 2, (window.innerHeight - free.top - free.bottom) / 2,
      window.innerWidth, window.innerHeight,
    );
    viewer.set_dirty();
  }

  // Corners of the boxes around every part below an object, in three.js' world axes.
  function corners(object) {
    const found = [];
    object.traverse((part) => {
      if (!part.geometry) return;
      if (!part.geometry.boundingBox) part.geometry.computeBoundingBox();
      const { min, max } = part.geometry.boundingBox;
      for (let k = 0; k < 8; k++) {
        const corner = new THREE.Vector3(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z);
        found.push(corner.applyMatrix4(part.matrixWorld));
      }
    });
    return found;
  }

  // Corners of the box around a target's ball: its place in the world [m], in three.js' axes.
  function around([x, y, z], radius = 0.03) {
    return [-1, 1].flatMap((a) => [-1, 1].flatMap((b) => [-1, 1].map((c) => (
      new THREE.Vector3(x + a * radius, z + b * radius, -y + c * radius)
    ))));
  }

  // Points that the camera should see: the robot all along its motion, all targets, and what stands wholly near.
  function subject(viewer, motion, markers) {
    const points = markers.flatMap(({ position }) => around(position));
    const steps = motion.duration ? 48 : 0;
    for (let k = 0; k <= steps; k++) {
      motion.seek(motion.start + (k / Math.max(steps, 1)) * motion.duration);
      viewer.scene.updateMatrixWorld(true);
      points.push(...corners(viewer.scene_tree.find(["links"]).object));
    }
    motion.seek(motion.start);
    const near = new THREE.Box3().setFromPoints(points).expandByScalar(1);
    for (const object of viewer.scene_tree.find(["world"]).object.children) {
      const around = corners(object);
      if (points.length === 0 || around.every((corner) => near.containsPoint(corner))) points.push(...around);
    }
    if (points.length === 0) points.push(new THREE.Vector3(0, 0, 0), new THREE.Vector3(0, 1.2, 0));
    return points;
  }

  // Draw everything below an object in red, or in its own colors again.
  function tint(object, on) {
    object.traverse(({ material, userData }) => {
      if (!material?.color) return;
      userData.ownColor ??= material.color.getHex();
      material.color.setHex(userData.ownColor);
      if (on) material.color.lerp(CONTACT, 0.75);
    });
  }

  // Glass throws no shadow, and lies behind what is in the same place; solids throw that of their far side, which
  // cannot speckle the lit one.
  function castShadows(viewer) {
    viewer.scene.traverse((object) => {
      if (!object.material) return;
      if (object.material.opacity < 0.6) {
        object.castShadow = false;
        Object.assign(object.material, { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8 });
      }
      object.material.shadowSide = THREE.BackSide;
    });
  }

  function open() {
    const viewer = new MeshCat.Viewer(document.getElementById("view"));
    viewer.gui.domElement.style.display = "none"; // the panel below is the page's own
    const content = readContent();
    addLights(viewer);
    addFloor(viewer);
    content.commands.forEach((command) => viewer.handle_command(command));
    castShadows(viewer);
    return { viewer, content };
  }

  // Lights and floor around a viewer whose content comes from elsewhere, in a part of the window.
  function furnish(viewer, ownRoom) {
    viewer.gui.domElement.style.display = "none";
    room = ownRoom;
    addLights(viewer);
    addFloor(viewer);
  }

  return {
    open, furnish, look, stand, standing, cameraOf, keepCamera, forgetCamera, fitWindow, subject, around, layFloor, lightUp,
    corners, castShadows, tint, isDark, VIEWS,
  };
})();
