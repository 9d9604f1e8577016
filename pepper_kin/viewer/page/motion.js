"use strict";
// The motion: poses at any time between the frames, and the clock that plays them.
class Motion {
  constructor(viewer, data) {
    this.viewer = viewer;
    this.times = data.times;
    this.positions = data.positions;
    this.quaternions = data.quaternions;
    this.links = data.links.map((link) => viewer.scene_tree.find(link.path).object);
    this.start = this.times[0];
    this.end = this.times[this.times.length - 1];
    this.duration = this.end - this.start;
    this.time = this.start;
    this.speed = 1;
    this.loop = false;
    this.playing = false;
    this.listeners = [];
    this.seek(this.start);
  }

  // The frame at or before a time, and how far towards the next one the time lies, in [0, 1).
  locate(time) {
    let low = 0;
    let high = this.times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= time) low = middle;
      else high = middle - 1;
    }
    if (low === this.times.length - 1) return [low, 0];
    return [low, Math.max(0, (time - this.times[low]) / (this.times[low + 1] - this.times[low]))];
  }

  seek(time) {
    this.time = Math.min(this.end, Math.max(this.start, time));
    const [frame, blend] = this.locate(this.time);
    const next = Math.min(frame + 1, this.times.length - 1);
    const count = this.links.length;
    const quaternion = [0, 0, 0, 1];
    for (let k = 0; k < count; k++) {
      const a = frame * count + k;
      const b = next * count + k;
      const at = (axis) => (1 - blend) * this.positions[3 * a + axis] + blend * this.positions[3 * b + axis];
      MeshCat.THREE.Quaternion.slerpFlat(quaternion, 0, this.quaternions, 4 * a, this.quaternions, 4 * b, blend);
      this.links[k].position.set(at(0), at(1), at(2));
      this.links[k].quaternion.fromArray(quaternion);
    }
    // The middle of all links, roughly: where the shadow falls.
    const middle = (axis) => this.links.reduce((sum, { position }) => sum + position[axis], 0) / Math.max(count, 1);
    stage.lightUp(this.viewer, middle("x"), middle("y"));
    this.viewer.set_dirty();
    this.listeners.forEach((listener) => listener(this));
  }

  play() {
    if (this.playing || this.duration === 0) return;
    if (this.time >= this.end) this.seek(this.start);
    this.playing = true;
    let before = performance.now();
    const tick = (now) => {
      const time = this.time + (this.speed * Math.max(0, now - before)) / 1000;
      before = now;
      if (time < this.end) this.seek(time);
      else if (this.loop) this.seek(this.start + ((time - this.start) % this.duration));
      else {
        this.playing = false;
        this.seek(this.end);
        return;
      }
      this.request = requestAnimationFrame(tick);
    };
    this.request = requestAnimationFrame(tick);
    this.listeners.forEach((listener) => listener(this));
  }

  pause() {
    this.playing = false;
    cancelAnimationFrame(this.request);
    this.listeners.forEach((listener) => listener(this));
  }
}
