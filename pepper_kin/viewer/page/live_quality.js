"use strict";
// How finely the picture is drawn.  A graphics card draws everything at its best at once.  Where the processor
// has to do it, a moving picture is a sketch, with as few pixels as keep it moving, and a still one fine again.
class Quality {
  // Pixels drawn for each pixel of the screen along a side, from fine to coarse.
  static MOVING = [1, 0.7, 0.5];
  static STILL = 1.5; // more than one pixel for each: smooth edges
  static SLOW = 36; // milliseconds from frame to frame above which the next is drawn coarser
  static QUICK = 20; // and below which, for a while, it is drawn finer
  static PAUSE = 350; // milliseconds without a frame after which the picture counts as still
  static PATIENCE = 4; // so many times longer while somebody holds what is dragged, and so many slow frames

  static makeRenderer() {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl");
    if (!context) throw new Error("no WebGL");
    const about = context.getExtension("WEBGL_debug_renderer_info");
    const name = about ? context.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
    const software = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
    context.getExtension("WEBGL_lose_context")?.loseContext();
    const renderer = new MeshCat.THREE.WebGLRenderer({ antialias: !software, alpha: true });
    renderer.shadowMap.enabled = true;
    return { renderer, software };
  }

  constructor(viewer, software) {
    Object.assign(this, { viewer, software, level: 0, last: 0, quick: 0, slow: 0, still: false, pace: 0 });
    if (software) this.take(Quality.MOVING[this.level]);
  }

  take(ratio) {
    const wanted = ratio * window.devicePixelRatio;
    if (this.viewer.renderer.getPixelRatio() !== wanted) {
      this.viewer.renderer.setPixelRatio(wanted);
      this.viewer.set_3d_pane_size();
    }
  }

  // Whether the picture is as fine as it will get.
  get settled() {
    return !this.software || this.still;
  }

  // Whether the next frame is a sketch.
  get sketched() {
    return this.software && !this.finishing;
  }

  // To be called before each frame.
  before() {
    if (!this.software || this.finishing) return;
    this.still = false;
    this.take(Quality.MOVING[this.level]);
  }

  // To be called after each frame.
  after() {
    if (!this.software) return;
    if (this.finishing) {
      this.finishing = false;
      this.still = true;
      this.last = 0;
      return;
    }
    const now = performance.now();
    const passed = now - this.last;
    this.last = now;
    if (passed < 1000) this.pace = passed;
    if (passed < 500) this.judge(passed);
    const held = this.viewer.controls.enabled ? 1 : Quality.PATIENCE;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.finish(), Math.max(held * Quality.PAUSE, Quality.PATIENCE * this.pace));
  }

  judge(passed) {
    this.slow = passed > Quality.SLOW ? this.slow + 1 : 0;
    this.quick = passed < Quality.QUICK ? this.quick + 1 : 0;
    if (this.slow >= 3 && this.level < Quality.MOVING.length - 1) {
      this.level += 1;
      this.slow = 0;
    } else if (this.quick >= 60 && this.level > 0) {
      this.level -= 1;
      this.quick = 0;
    }
  }

  finish() {
    this.finishing = true;
    this.take(Quality.STILL);
    this.viewer.set_dirty();
  }
}
