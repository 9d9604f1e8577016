"use strict";
// Dragging in the picture: what is under the pointer moves in the plane through it that is parallel to the
// screen, whatever the camera's place.
class Drag {
  static REACH = 22; // pixels from a target's middle within which it is taken hold of

  constructor(view, viewer, handles) {
    Object.assign(this, { view, viewer, handles });
    this.ray = new MeshCat.THREE.Raycaster();
    this.hold = null;
    // In the capture phase, before the camera's own controls see the event.
    view.addEventListener("pointerdown", (event) => this.begin(event), true);
    view.addEventListener("pointermove", (event) => this.move(event), true);
    for (const type of ["pointerup", "pointercancel"]) view.addEventListener(type, (event) => this.end(event), true);
  }

  // The pointer in the picture: pixels, and three.js' device coordinates.
  pointer(event) {
    const box = this.view.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    return { x, y, device: new MeshCat.THREE.Vector2((2 * x) / box.width - 1, 1 - (2 * y) / box.height), box };
  }

  // A place in the robot's axes, as a vector in three.js' axes, and back.
  static toScene([x, y, z]) {
    return new MeshCat.THREE.Vector3(x, z, -y);
  }

  static toRobot({ x, y, z }) {
    return [x, -z, y];
  }

  // What can be taken hold of here: the nearest target, or else the foremost obstacle.
  under(pointer) {
    let best = null;
    for (const handle of this.handles.targets()) {
      const place = Drag.toScene(handle.place).project(this.viewer.camera);
      const away = Math.hypot(
        ((place.x + 1) / 2) * pointer.box.width - pointer.x, ((1 - place.y) / 2) * pointer.box.height - pointer.y,
      );
      if (away < (best?.away ?? Drag.REACH) && place.z < 1) best = { ...handle, away };
    }
    if (best) return best;
    this.ray.setFromCamera(pointer.device, this.viewer.camera);
    const root = this.handles.obstacleRoot();
    root.updateWorldMatrix(true, true); // a sketch leaves the objects where they were drawn finely
    const [hit] = this.ray.intersectObject(root, true);
    return hit ? this.handles.obstacle(hit.object) : null;
  }

  begin(event) {
    if (event.button !== 0 || this.hold || event.target.closest("button, input")) return;
    const pointer = this.pointer(event);
    const handle = this.under(pointer);
    if (!handle) return;
    event.stopPropagation();
    event.preventDefault();
    this.view.setPointerCapture(event.pointerId);
    const middle = Drag.toScene(handle.place);
    const normal = this.viewer.camera.getWorldDirection(new MeshCat.THREE.Vector3());
    const plane = new MeshCat.THREE.Plane().setFromNormalAndCoplanarPoint(normal, middle);
    const grip = this.meet(pointer, plane);
    this.hold = { handle, plane, id: event.pointerId, offset: grip ? middle.sub(grip) : new MeshCat.THREE.Vector3() };
    this.viewer.controls.enabled = false;
    this.view.classList.add("held");
  }

  meet(pointer, plane) {
    this.ray.setFromCamera(pointer.device, this.viewer.camera);
    return this.ray.ray.intersectPlane(plane, new MeshCat.THREE.Vector3());
  }

  move(event) {
    if (!this.hold) {
      if (event.pointerType === "mouse" && event.buttons === 0) {
        this.view.classList.toggle("grab", this.under(this.pointer(event)) !== null);
      }
      return;
    }
    if (event.pointerId !== this.hold.id) return;
    event.stopPropagation();
    const met = this.meet(this.pointer(event), this.hold.plane);
    if (met) this.hold.handle.moved(Drag.toRobot(met.add(this.hold.offset)));
  }

  end(event) {
    if (!this.hold || event.pointerId !== this.hold.id) return;
    event.stopPropagation();
    this.hold.handle.dropped();
    this.hold = null;
    this.viewer.controls.enabled = true;
    this.view.classList.remove("held");
  }
}
