"use strict";
// The axes of a small plot: a height for each value, a place for each time, lines at limits, and numbers with units.
class Axes {
  static LEFT = 52; // pixels for the numbers beside the plot, up to "1000 mm" in a wide font
  static BOTTOM = 15; // and for the times below it
  static TOP = 5;

  // A number without the sign that rounding leaves to nothing.
  static fixed(value, digits) {
    const text = value.toFixed(digits);
    return Number(text) === 0 ? text.replace("-", "") : text;
  }

  // A color of the page, such as "--quiet".
  static color(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  // size: width, height and ratio of the canvas [device pixel]; range: start and end [s], low and high.
  constructor(size, range) {
    Object.assign(this, size, range);
    this.left = Axes.LEFT * this.ratio;
    this.floor = this.height - Axes.BOTTOM * this.ratio;
    this.ceiling = Axes.TOP * this.ratio;
  }

  x(time) {
    return this.left + ((time - this.start) / Math.max(this.end - this.start, 1e-9)) * (this.width - this.left);
  }

  y(value) {
    return this.floor - ((value - this.low) / (this.high - this.low)) * (this.floor - this.ceiling);
  }

  // The time below a place on the page, for a canvas with a box on it.
  static timeAt(box, place, start, end) {
    const share = (place - box.left - Axes.LEFT) / Math.max(box.width - Axes.LEFT, 1);
    return start + Math.min(Math.max(share, 0), 1) * (end - start);
  }

  // Draw lines and numbers: ticks and times as pairs of value and text, limits as values.
  draw(context, { ticks, limits, times }) {
    context.font = `${10 * this.ratio}px system-ui, sans-serif`;
    context.lineWidth = this.ratio;
    context.fillStyle = Axes.color("--quiet");
    context.strokeStyle = Axes.color("--line");
    context.textAlign = "right";
    context.textBaseline = "middle";
    for (const [value, text] of ticks) {
      this.line(context, [[this.left, this.y(value)], [this.width, this.y(value)]]);
      context.fillText(text, this.left - 4 * this.ratio, Math.max(this.y(value), 6 * this.ratio));
    }
    context.textBaseline = "bottom";
    times.forEach(([time, text], k) => {
      context.textAlign = ["left", "center", "right"][k === 0 ? 0 : k === times.length - 1 ? 2 : 1];
      context.fillText(text, this.x(time), this.height);
    });
    context.strokeStyle = Axes.color("--bad");
    context.setLineDash([4 * this.ratio, 3 * this.ratio]);
    for (const value of limits) this.line(context, [[this.left, this.y(value)], [this.width, this.y(value)]]);
    context.setLineDash([]);
  }

  // Draw a line through points; null breaks it.
  line(context, points) {
    context.beginPath();
    let begun = false;
    for (const point of points) {
      if (point === null) begun = false;
      else if (begun) context.lineTo(...point);
      else context.moveTo(...point);
      begun = point !== null;
    }
    context.stroke();
  }

  // Draw the mark at a time.
  mark(context, time) {
    context.fillStyle = Axes.color("--ink");
    context.fillRect(Math.min(this.x(time), this.width - this.ratio), this.ceiling, this.ratio, this.floor - this.ceiling);
  }
}
