"use strict";
// How finely the picture is drawn.  A graphics card draws everything at its best at once.  Where the processor
// has to do it, a moving picture is drawn coarser, by as much as keeps it moving, and a still one finely again.
class Quality {
  // From fine to coarse: pixels drawn for each pixel of the screen along a side, shadows, fewer triangles.
  static MOVING = [
    { ratio: 1, shadows: true, coarse: false },
    { ratio: 1, shadows: false, coarse: true },
    { ratio: 0.7, shadows: false, coarse: true },
    { ratio: 0.5, shadows: false, coarse: true },
  ];
  static STILL = { ratio: 1.5, shadows: true, coarse: false }; // more than one pixel for each: smooth edges
  static SLOW = 36; // milliseconds from frame to frame above which the next is drawn coarser
  static QUICK = 20; // and below which, for a while, it is drawn finer
  static PAUSE = 350; // milliseconds without a frame after which the picture counts as still

  static makeRenderer() {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl");
    if (!context) throw new Error("no WebGL");
    const about = context.getExtension("WEBGL_debug_renderer_info");
    const name = about ? context.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
    const software = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
    context.getExtension("WEBGL_lose_context")?.loseContext();
    const renderer = new MeshCat.THREE.WebGLRenderer({ antialias: !software, alpha: !software });
    renderer.shadowMap.enabled = true;
    return { renderer, software };
  }

  constructor(viewer, software) {
    Object.assign(this, { viewer, software, level: 1, last: 0, quick: 0, slow: 0, still: false, coarse: false });
    const part = (name) => viewer.scene_tree.find(["Stage", name, "<object>"]).object;
    [this.light, this.floor] = ["key", "shade"].map(part); // the floor shows shadows and nothing else
    if (software) this.take(Quality.MOVING[this.level]);
  }

  take({ ratio, shadows, coarse }) {
    this.coarse = coarse;
    const wanted = ratio * window.devicePixelRatio;
    if (this.viewer.renderer.getPixelRatio() !== wanted) {
      this.viewer.renderer.setPixelRatio(wanted);
      this.viewer.set_3d_pane_size();
    }
    this.light.castShadow = this.floor.visible = shadows;
  }

  // Whether the picture is as fine as it will get.
  get settled() {
    return !this.software || this.still;
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
    if (passed < 500) this.judge(passed);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.finish(), Quality.PAUSE);
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
