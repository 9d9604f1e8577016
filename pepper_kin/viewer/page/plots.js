"use strict";
// Small curves beside the motion: a line through the frames, the band that the samples between them span, and
// a cursor at the present time.  Pressing on a curve seeks to that time.  A curve with a limit is drawn as a share of it.
class Plot {
  constructor(parent, motion, series, hue) {
    this.motion = motion;
    this.series = series;
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
    this.setRange();
    const seek = (event) => {
      if (event.buttons !== 1) return;
      const box = this.canvas.getBoundingClientRect();
      motion.seek(Axes.timeAt(box, event.clientX, motion.start, motion.end));
    };
    this.canvas.addEventListener("pointerdown", seek);
    this.canvas.addEventListener("pointermove", seek);
    this.picture = document.createElement("canvas");
  }

  // What the axis spans: both limits, or else the values.
  setRange() {
    const { low: lows, high: highs, limit } = this.series;
    let [low, high] = [Math.min(...lows), Math.max(...highs)];
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

  axes(canvas) {
    const { width, height } = canvas;
    const { start, end } = this.motion;
    return new Axes({ width, height, ratio: window.devicePixelRatio || 1 }, { start, end, low: this.low, high: this.high });
  }

  // Draw the curve once per size and color scheme; the cursor moves over a copy of it.
  resize() {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * ratio);
    const height = Math.round(this.canvas.clientHeight * ratio);
    const scheme = Axes.color("--ink");
    if (!width || (width === this.canvas.width && height === this.canvas.height && this.drawn === scheme)) return;
    for (const canvas of [this.canvas, this.picture]) [canvas.width, canvas.height] = [width, height];
    const context = this.picture.getContext("2d");
    const { times, start, end } = this.motion;
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
    const last = times.length - 1;
    context.fillStyle = context.strokeStyle = `hsl(${this.hue} 62% ${Axes.color("--curve")})`;
    context.globalAlpha = 0.2;
    context.beginPath();
    trace(this.series.high, 0, last);
    trace(this.series.low, last, 0);
    context.fill();
    context.globalAlpha = 1;
    context.lineWidth = 1.5 * ratio;
    context.beginPath();
    trace(this.series.value, 0, last);
    context.stroke();
    this.drawn = scheme;
  }

  draw() {
    this.resize();
    if (!this.drawn) return;
    const { motion, canvas, series } = this;
    const [frame, blend] = motion.locate(motion.time);
    const next = Math.min(frame + 1, motion.times.length - 1);
    const value = (1 - blend) * series.value[frame] + blend * series.value[next];
    const share = series.limit ? ` ${this.unit}, ${Axes.fixed((100 * value) / series.limit, 0)} %` : "";
    this.reading.textContent = this.format(value) + share;
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(this.picture, 0, 0);
    this.axes(canvas).mark(context, motion.time);
  }
}
