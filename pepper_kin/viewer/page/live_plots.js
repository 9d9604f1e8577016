"use strict";
// Small plots: torque and speed of each joint as shares of their limits, the smallest distances to obstacles and of the
// robot to itself, and how far inside the wheels the zero-moment point is.  They show the last seconds, or the whole of a motion with a mark at its time.
class Plots {
  static SPAN = 12; // seconds
  static STEP = 100; // milliseconds between two paintings: curves cost more than a robot where there is no card
  // Of each plot: the factor and unit of what is shown, its limit, and the least that its axis spans [own unit].
  static KINDS = {
    torque: { scale: 100, unit: "%", limit: 1, span: [0, 1] },
    speed: { scale: 100, unit: "%", limit: 1, span: [0, 1] },
    obstacles: { scale: 1000, unit: "mm", limit: 0, span: [0, 0.05] },
    itself: { scale: 1000, unit: "mm", limit: 0, span: [0, 0.05] },
    balance: { scale: 1000, unit: "mm", limit: 0, span: [0, 0.1] },
  };

  constructor(robot) {
    this.joints = robot.joints.map((joint) => joint.name);
    this.samples = [];
    this.motion = null;
    this.inMotion = false;
    this.time = 0;
    this.canvases = new Map(Object.keys(Plots.KINDS).map((kind) => [kind, document.getElementById(`plot-${kind}`)]));
    this.canvases.get("balance").closest("figure").hidden = !robot.balance;
    this.asked = false;
    this.kept = new Map();
    window.onresize = () => this.draw();
  }

  setHistory(samples) {
    this.samples = samples;
    this.draw();
  }

  add(sample) {
    const last = this.samples[this.samples.length - 1];
    if (last && last.time === sample.time) return;
    this.samples.push(sample);
    if (this.samples.length > 400) this.samples.shift();
    this.draw();
  }

  draw() {
    if (this.asked) return;
    this.asked = true;
    setTimeout(() => {
      this.asked = false;
      this.paint();
    }, Plots.STEP);
  }

  paint() {
    const now = this.samples[this.samples.length - 1];
    if (now) this.read(now);
    const shown = this.inMotion && this.motion ? this.wholeMotion() : this.lastSeconds();
    if (!shown) return;
    for (const [kind, canvas] of this.canvases) if (shown[kind]?.length) this.plot(canvas, Plots.KINDS[kind], shown, shown[kind]);
  }

  read(sample) {
    const say = (kind, text) => (document.getElementById(`plot-${kind}-reading`).textContent = text);
    for (const kind of ["torque", "speed"]) {
      const most = sample[kind].indexOf(Math.max(...sample[kind]));
      const over = sample[kind][most] > 1 ? ", over its limit" : "";
      say(kind, `${Axes.fixed(100 * sample[kind][most], 0)} % ${this.joints[most]}${over}`);
    }
    // While the body follows, nothing limits torque: the plot shows what the motors would need.
    const name = this.inMotion ? "Torque, share of limit" : "Torque needed, not limited";
    document.getElementById("plot-torque-name").textContent = name;
    const length = (value) => (value === null ? "–" : `${Axes.fixed(1000 * value, 1)} mm`);
    for (const kind of ["obstacles", "itself"]) {
      say(kind, sample[kind] === null ? "none" : `${length(sample[kind])} ${sample.pairs[kind].join(" – ")}`);
    }
    say("balance", length(sample.balance));
  }

  wholeMotion() {
    const middle = (this.motion.start + this.motion.end) / 2;
    const digits = this.motion.end - this.motion.start < 1 ? 2 : 1;
    const ticks = [this.motion.start, middle, this.motion.end].map((time) => [time, `${Axes.fixed(time, digits)} s`]);
    return { ...this.motion, ticks, mark: this.time };
  }

  lastSeconds() {
    const end = this.samples[this.samples.length - 1]?.time;
    if (end === undefined) return null;
    const kept = this.samples.filter((sample) => sample.time >= end - Plots.SPAN);
    const curves = Object.fromEntries(Object.keys(Plots.KINDS).map((kind) => [kind, kept.map((sample) => sample[kind])]));
    const ticks = [[end - Plots.SPAN, `−${Plots.SPAN} s`], [end - Plots.SPAN / 2, `−${Plots.SPAN / 2} s`], [end, "now"]];
    return { ...curves, times: kept.map((sample) => sample.time), start: end - Plots.SPAN, end, ticks, mark: null };
  }

  // Draw the curves of one kind over time: rows hold one value, or one for each joint.
  plot(canvas, kind, shown, rows) {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    // Painted by the processor: so small a picture is not worth the way to a graphics card and back.
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.clearRect(0, 0, width, height);
    const values = rows.flat().filter((value) => value !== null);
    const [low, high] = [Math.min(kind.span[0], ...values), Math.max(kind.span[1], ...values)];
    const room = 0.06 * (high - low);
    const range = { start: shown.start, end: shown.end, low: low < kind.span[0] ? low - room : low, high: high + room };
    const axes = new Axes({ width, height, ratio }, range);
    const key = shown.mark === null ? null : this.motion;
    const scheme = Axes.color("--ink");
    let kept = this.kept.get(canvas);
    if (!key || kept?.key !== key || kept.width !== width || kept.height !== height || kept.scheme !== scheme) {
      this.paths(context, axes, kind, shown, rows);
      // The curves of a motion stay as they are: only the mark moves over them.
      kept = key && { key, width, height, scheme, picture: context.getImageData(0, 0, width, height) };
      this.kept.set(canvas, kept);
    } else {
      context.putImageData(kept.picture, 0, 0);
    }
    if (shown.mark !== null) axes.mark(context, shown.mark);
  }

  paths(context, axes, { scale, unit, limit, span }, { times, ticks }, rows) {
    const label = (value) => [value, `${Axes.fixed(scale * value, 0)} ${unit}`];
    // The limits themselves, and the ends of the axis where they are far from those.
    const heights = [span[0], span[1], axes.low, axes.high].filter((value, k, all) => (
      k < 2 || all.slice(0, k).every((other) => Math.abs(other - value) > 0.25 * (axes.high - axes.low))
    ));
    axes.draw(context, { ticks: heights.map(label), limits: [limit], times: ticks });
    context.lineWidth = axes.ratio;
    const count = Array.isArray(rows[0]) ? rows[0].length : 1;
    for (let k = 0; k < count; k++) {
      context.strokeStyle = count === 1 ? Axes.color("--accent") : `hsl(${(211 + 47 * k) % 360} 62% ${Axes.color("--curve")})`;
      axes.line(context, rows.map((row, at) => {
        const value = count === 1 ? row : row[k];
        return value === null ? null : [axes.x(times[at]), axes.y(value)];
      }));
    }
  }
}
