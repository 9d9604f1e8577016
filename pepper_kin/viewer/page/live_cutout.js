"use strict";
// The part of the picture in which something moves.  Without a graphics card each pixel of the canvas is cleared,
// copied and composed by the processor, moved or not: so a sketch's canvas covers no more than it needs.
class Cutout {
  static GRID = 32; // the canvas begins and ends on multiples of so many pixels
  static SPARE = 24; // and leaves so many around what is drawn, for it is costly to change
  static WASTE = 2; // it shrinks when it is so many times larger than needed

  constructor(viewer) {
    this.viewer = viewer;
    this.box = null; // the part that is drawn: x, y, width and height; null for all of it
    const resize = viewer.set_3d_pane_size;
    viewer.set_3d_pane_size = () => {
      resize();
      this.opened();
    };
    this.opened();
  }

  // To be called when the canvas was given the size of the whole picture.
  opened() {
    const { renderer } = this.viewer;
    this.box = null;
    ({ x: this.width, y: this.height } = renderer.getSize(new MeshCat.THREE.Vector2()));
    renderer.domElement.style.left = renderer.domElement.style.top = "0";
  }

  // Draw all of the picture again.
  open() {
    if (this.box) this.viewer.set_3d_pane_size();
  }

  // Draw no more than the part in which some points lie: x, y, z in turn, seen through a projection.
  fit(points, projection) {
    const { box, width, height } = this;
    const needed = Cutout.around(points, projection, width, height);
    const inside = box && needed[0] >= box[0] && needed[1] >= box[1] && needed[2] <= box[0] + box[2] && needed[3] <= box[1] + box[3];
    const [x, y, right, bottom] = [
      Math.max(0, Cutout.down(needed[0] - Cutout.SPARE)), Math.max(0, Cutout.down(needed[1] - Cutout.SPARE)),
      Math.min(width, Cutout.up(needed[2] + Cutout.SPARE)), Math.min(height, Cutout.up(needed[3] + Cutout.SPARE)),
    ];
    const size = [Math.max(right - x, Cutout.GRID), Math.max(bottom - y, Cutout.GRID)];
    if (inside && box[2] * box[3] <= Cutout.WASTE * size[0] * size[1]) return;
    this.box = [x, y, ...size];
    this.viewer.renderer.setSize(...size);
    Object.assign(this.viewer.renderer.domElement.style, { left: `${x}px`, top: `${y}px` });
  }

  static down(pixels) {
    return Cutout.GRID * Math.floor(pixels / Cutout.GRID);
  }

  static up(pixels) {
    return Cutout.GRID * Math.ceil(pixels / Cutout.GRID);
  }

  // Left, top, right and bottom of points on the screen; the whole of it where one is not in front of the camera.
  static around(points, projection, width, height) {
    const m = projection.elements;
    let left = width, top = height, right = 0, bottom = 0;
    for (let at = 0; at < points.length; at += 3) {
      const x = points[at], y = points[at + 1], z = points[at + 2];
      const w = m[3] * x + m[7] * y + m[11] * z + m[15];
      if (w < 1e-3) return [0, 0, width, height];
      const across = (0.5 + (0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12])) / w) * width;
      const down = (0.5 - (0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13])) / w) * height;
      left = Math.min(left, across);
      right = Math.max(right, across);
      top = Math.min(top, down);
      bottom = Math.max(bottom, down);
    }
    const clamp = (value, most) => Math.min(Math.max(value, 0), most);
    return [clamp(left, width), clamp(top, height), clamp(right, width), clamp(bottom, height)];
  }

  // Draw with the camera that sees only this part.
  through(draw) {
    const { camera } = this.viewer;
    if (this.box) camera.setViewOffset(this.width, this.height, ...this.box);
    draw();
    if (this.box) camera.clearViewOffset();
  }
}
