"use strict";
// Small curves beside the motion: a line through the frames, the band that the samples between them span, and
// a cursor at the present time.  Pressing on a curve seeks to that time.  A curve with a limit is drawn as a share of it.
// Lines of a ghost and of a command go with the curve; times of notes are shaded.
class Plot {
  static LONGEST = 60; // motions of more seconds are shown in parts,
  static PART = 30; // of so many

  constructor(parent, motion, series, { hue, ghost, spans }) {
    this.motion = motion;
    this.series = series;
    this.ghost = ghost;
    this.spans = spans;
    this.unit = /\[(.*)\]$/.exec(series.name)?.[1] ?? "";
    this.hue = hue;
    const figure = document.createElement("figure");
    figure.className = "plot";
    const caption = document.createElement("figcaption");
    const name = document.createElement("span");
    // The reading has the unit of a curve that is drawn as a share.
    name.textContent = series.limit ? series.name.replace(/ \[.*\]$/, "") : series.name;
    this.reading = document.createElement("b");
    caption.append(name, this.reading);
    this.canvas = document.createElement("canvas");
    figure.append(caption, this.canvas);
    parent.append(figure);
    const seek = (event) => {
      if (event.buttons !== 1) return;
      const { start, end } = this.part();
      motion.seek(Axes.timeAt(this.canvas.getBoundingClientRect(), event.clientX, start, end));
    };
    this.canvas.addEventListener("pointerdown", seek);
    this.canvas.addEventListener("pointermove", seek);
    this.picture = document.createElement("canvas");
  }

  // What the axis spans: both limits, or else the values from the first to the last frame.
  setRange(first, last) {
    const { low: lows, high: highs, limit, ghost, command } = this.series;
    const values = [lows, highs, ghost ?? [], command ?? []].flatMap((line) => [...line.slice(first, last + 1)]);
    let [low, high] = [Math.min(...values), Math.max(...values)];
    if (limit) {
      const most = 1.06 * Math.max(limit, Math.abs(low), Math.abs(high));
      [this.low, this.high] = [-most, most];
      this.ticks = [-1, 0, 1].map((share) => [share * limit, `${100 * share} %`]);
      return;
    }
    this.ticks = (high - low < 1e-9 ? [low] : [low, high]).map((value) => [value, this.format(value)]);
    if (high - low < 1e-9) [low, high] = [low - 1, high + 1];
    this.low = low - 0.06 * (high - low);
    this.high = high + 0.06 * (high - low);
  }

  format(value) {
    const text = value.toPrecision(3);
    return Number(text) === 0 ? "0" : text;
  }

  // What the plot shows of the motion: all, or of a long one the part with the present time [s].
  part() {
    const { start, end, time } = this.motion;
    if (end - start <= Plot.LONGEST) return { start, end };
    const begin = Math.min(start + Plot.PART * Math.floor((time - start) / Plot.PART), end - Plot.PART);
    return { start: begin, end: begin + Plot.PART };
  }

  axes(canvas) {
    const { width, height } = canvas;
    const range = { ...this.part(), low: this.low, high: this.high };
    return new Axes({ width, height, ratio: window.devicePixelRatio || 1 }, range);
  }

  // Draw the curve once per size, color scheme and part; the cursor moves over a copy of it.
  resize() {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * ratio);
    const height = Math.round(this.canvas.clientHeight * ratio);
    const { start, end } = this.part();
    const look = `${Axes.color("--ink")} ${start}`;
    if (!width || (width === this.canvas.width && height === this.canvas.height && this.drawn === look)) return;
    for (const canvas of [this.canvas, this.picture]) [canvas.width, canvas.height] = [width, height];
    const context = this.picture.getContext("2d");
    const { times } = this.motion;
    const first = this.motion.locate(start)[0];
    const last = Math.min(this.motion.locate(end)[0] + 1, times.length - 1);
    this.setRange(first, last);
    const axes = this.axes(this.picture);
    const { limit } = this.series;
    const marks = end > start ? [start, (start + end) / 2, end] : [];
    axes.draw(context, {
      ticks: this.ticks,
      limits: limit ? [-limit, limit] : [],
      times: marks.map((time) => [time, `${Axes.fixed(time, end - start < 1 ? 2 : 1)} s`]),
    });
    const trace = (values, from, to) => {
      const step = from < to ? 1 : -1;
      for (let k = from; k !== to + step; k += step) context.lineTo(axes.x(times[k]), axes.y(values[k]));
    };
    const stroke = (values, style, thickness) => {
      context.strokeStyle = style;
      context.lineWidth = thickness * ratio;
      context.beginPath();
      trace(values, first, last);
      context.stroke();
    };
    context.beginPath();
    context.rect(axes.left, 0, width - axes.left, height);
    context.clip();
    const hue = `hsl(${this.hue} 62% ${Axes.color("--curve")})`;
    context.globalAlpha = 0.2;
    context.fillStyle = Axes.color("--bad");
    for (const span of this.spans) {
      const left = axes.x(span.start);
      context.fillRect(left, axes.ceiling, Math.max(axes.x(span.end) - left, ratio), axes.floor - axes.ceiling);
    }
    context.fillStyle = hue;
    context.beginPath();
    trace(this.series.high, first, last);
    trace(this.series.low, last, first);
    context.fill();
    context.globalAlpha = 1;
    if (this.series.command) stroke(this.series.command, Axes.color("--quiet"), 1);
    if (this.series.ghost) stroke(this.series.ghost, this.ghost.color, 1.5);
    stroke(this.series.value, hue, 1.5);
    this.drawn = look;
  }

  draw() {
    this.resize();
    if (!this.drawn) return;
    const { motion, canvas, series } = this;
    const [frame, blend] = motion.locate(motion.time);
    const next = Math.min(frame + 1, motion.times.length - 1);
    const at = (line) => (1 - blend) * line[frame] + blend * line[next];
    const value = at(series.value);
    const share = series.limit ? ` ${this.unit}, ${Axes.fixed((100 * value) / series.limit, 0)} %` : "";
    const there = series.ghost ? `, ${this.ghost.name} ${this.format(at(series.ghost))}` : "";
    this.reading.textContent = this.format(value) + share + there;
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(this.picture, 0, 0);
    this.axes(canvas).mark(context, motion.time);
  }
}
