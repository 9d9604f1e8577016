"use strict";
// Small curves beside the motion: a line through the frames, the band that the samples between them span, and
// a cursor at the present time.  Pressing on a curve seeks to that time.
class Plot {
  constructor(parent, motion, series, hue) {
    this.motion = motion;
    this.series = series;
    this.color = `hsl(${hue}, 62%, 45%)`;
    const figure = document.createElement("figure");
    figure.className = "plot";
    const caption = document.createElement("figcaption");
    const name = document.createElement("span");
    name.textContent = series.name;
    this.reading = document.createElement("b");
    caption.append(name, this.reading);
    this.canvas = document.createElement("canvas");
    figure.append(caption, this.canvas);
    parent.append(figure);
    let low = Math.min(...series.low);
    let high = Math.max(...series.high);
    if (high - low < 1e-9) [low, high] = [low - 1, high + 1];
    this.low = low - 0.06 * (high - low);
    this.high = high + 0.06 * (high - low);
    const seek = (event) => {
      if (event.buttons !== 1) return;
      const box = this.canvas.getBoundingClientRect();
      motion.seek(motion.start + ((event.clientX - box.left) / box.width) * motion.duration);
    };
    this.canvas.addEventListener("pointerdown", seek);
    this.canvas.addEventListener("pointermove", seek);
    this.picture = document.createElement("canvas");
  }

  // Draw the curve once per size; the cursor moves over a copy of it.
  resize() {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * ratio);
    const height = Math.round(this.canvas.clientHeight * ratio);
    if (!width || (width === this.canvas.width && height === this.canvas.height && this.drawn)) return;
    for (const canvas of [this.canvas, this.picture]) [canvas.width, canvas.height] = [width, height];
    const context = this.picture.getContext("2d");
    const { times, start, duration } = this.motion;
    const x = (k) => (duration ? ((times[k] - start) / duration) * width : 0);
    const y = (value) => height * (1 - (value - this.low) / (this.high - this.low));
    const trace = (values, from, to) => {
      const step = from < to ? 1 : -1;
      for (let k = from; k !== to + step; k += step) context.lineTo(x(k), y(values[k]));
    };
    const last = times.length - 1;
    context.lineWidth = ratio;
    if (this.low < 0 && this.high > 0) {
      context.strokeStyle = "rgba(29, 39, 51, 0.18)";
      context.strokeRect(0, Math.round(y(0)) + 0.5, width, 0);
    }
    context.fillStyle = context.strokeStyle = this.color;
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
    this.drawn = true;
  }

  draw() {
    this.resize();
    if (!this.drawn) return;
    const { motion, canvas } = this;
    const [frame, blend] = motion.locate(motion.time);
    const next = Math.min(frame + 1, motion.times.length - 1);
    const value = (1 - blend) * this.series.value[frame] + blend * this.series.value[next];
    this.reading.textContent = value.toPrecision(3);
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.drawImage(this.picture, 0, 0);
    const x = motion.duration ? ((motion.time - motion.start) / motion.duration) * canvas.width : 0;
    context.fillStyle = "rgba(29, 39, 51, 0.65)";
    context.fillRect(Math.min(Math.round(x), canvas.width - 1), 0, Math.max(1, window.devicePixelRatio), canvas.height);
  }
}
