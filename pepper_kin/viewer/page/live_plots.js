"use strict";
// Two small plots: how much of its torque each joint uses, and the smallest clearance.  They show the last
// seconds, or the whole of a motion with a mark at its present time.
class Plots {
  static SPAN = 12; // seconds
  static STEP = 100; // milliseconds between two paintings: curves cost more than a robot where there is no card

  constructor(robot) {
    this.joints = robot.joints.map((joint) => joint.name);
    this.samples = [];
    this.motion = null;
    this.inMotion = false;
    this.time = 0;
    [this.torque, this.clearance] = ["torque", "clearance"].map((id) => document.getElementById(id));
    this.readings = ["torque-reading", "clearance-reading"].map((id) => document.getElementById(id));
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
    this.curves(this.torque, shown, this.joints.map((_, k) => shown.torque.map((row) => row[k])), 1, 0.5);
    this.curves(this.clearance, shown, [shown.clearance], 0, 0.05);
  }

  read(sample) {
    const most = sample.torque.indexOf(Math.max(...sample.torque));
    this.readings[0].textContent = `${(100 * sample.torque[most]).toFixed(0)} % ${this.joints[most]}`;
    this.readings[1].textContent = sample.clearance === null
      ? "–" : `${(1000 * sample.clearance).toFixed(1)} mm ${sample.pair.join(" – ")}`;
  }

  wholeMotion() {
    const { times, torque, clearance, start, end } = this.motion;
    return { times, torque, clearance, start, end, mark: this.time };
  }

  lastSeconds() {
    const end = this.samples[this.samples.length - 1]?.time;
    if (end === undefined) return null;
    const kept = this.samples.filter((sample) => sample.time >= end - Plots.SPAN);
    return {
      times: kept.map((sample) => sample.time),
      torque: kept.map((sample) => sample.torque),
      clearance: kept.map((sample) => sample.clearance ?? 0),
      start: end - Plots.SPAN, end, mark: null,
    };
  }

  // Draw curves over time; `limit` is a line to stay away from, `least` the least height of the plot.
  curves(canvas, { times, start, end, mark }, curves, limit, least) {
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio].map(Math.round);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    // Painted by the processor: so small a picture is not worth the way to a graphics card and back.
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.clearRect(0, 0, width, height);
    const x = (time) => ((time - start) / Math.max(end - start, 1e-9)) * width;
    const key = mark === null ? null : this.motion;
    let kept = this.kept.get(canvas);
    if (!key || kept?.key !== key || kept.width !== width || kept.height !== height) {
      this.paths(context, times.map(x), curves, { width, height, ratio, limit, least });
      // The curves of a motion stay as they are: only the mark moves over them.
      kept = key && { key, width, height, picture: context.getImageData(0, 0, width, height) };
      this.kept.set(canvas, kept);
    } else {
      context.putImageData(kept.picture, 0, 0);
    }
    context.fillStyle = "rgba(29, 39, 51, 0.65)";
    if (mark !== null) context.fillRect(Math.min(x(mark), width - 1), 0, ratio, height);
  }

  paths(context, xs, curves, { width, height, ratio, limit, least }) {
    const all = curves.flat();
    const high = Math.max(least, ...all) * 1.08;
    const low = Math.min(0, ...all);
    const y = (value) => height - 1 - ((value - low) / (high - low)) * (height - 2);
    context.lineWidth = ratio;
    context.strokeStyle = "rgba(179, 38, 30, 0.55)";
    if (limit <= high) this.line(context, [[0, y(limit)], [width, y(limit)]]);
    curves.forEach((values, k) => {
      context.strokeStyle = curves.length === 1 ? "#1f6feb" : `hsl(${(211 + 47 * k) % 360} 62% 45%)`;
      this.line(context, values.map((value, at) => [xs[at], y(value)]));
    });
  }

  line(context, points) {
    context.beginPath();
    points.forEach(([x, y]) => context.lineTo(x, y));
    context.stroke();
  }
}
