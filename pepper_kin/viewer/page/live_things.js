"use strict";
// Things with a place: targets and obstacles, as rows of numbers and as handles in the picture.
const AXES = ["x", "y", "z"];

class TargetRows {
  constructor(robot, send) {
    this.send = send;
    this.rows = new Map();
    this.stamp = 0;
    this.sentAt = new Map(); // stamp -> time, for measuring how long a target takes to be drawn
    document.getElementById("targets").replaceChildren(...robot.targets.map((name) => this.row(name)));
    const press = (id, action) => (document.getElementById(id).onclick = action);
    press("release", () => send({ do: "release" }));
    press("plan", () => send({ do: "plan" }));
    press("go", () => send({ do: "go" }));
    const follow = document.getElementById("follow");
    follow.onchange = () => send({ do: "follow", on: follow.checked });
  }

  row(name) {
    const on = make("input", { type: "checkbox", ariaLabel: `${name} is a target`, title: "Reach it" });
    on.id = `on-${name.replaceAll(" ", "-")}`;
    const inputs = AXES.map((axis) => numberInput(`${name} ${axis} [m]`, 0.01, () => {
      this.move(name, inputs.map((input) => input.valueAsNumber));
    }));
    inputs.forEach((input, k) => (input.id = `${name.replaceAll(" ", "-")}-${AXES[k]}`));
    on.addEventListener("change", () => {
      if (on.checked) this.move(name, inputs.map((input) => input.valueAsNumber));
      else this.send({ do: "release", name });
    });
    const dot = make("i");
    dot.className = `dot ${name.replaceAll(" ", "-")}`;
    this.rows.set(name, { on, inputs, dot });
    const label = make("label", { className: "switch" }, on, dot, make("span", {}, name));
    return make("div", { className: "thing" }, make("span", { className: "name" }, label), ...inputs);
  }

  move(name, position) {
    if (!position.every(Number.isFinite)) return;
    this.stamp += 1;
    this.sentAt.set(this.stamp, performance.now());
    if (this.sentAt.size > 500) this.sentAt.delete(this.sentAt.keys().next().value);
    this.send({ do: "target", name, position, stamp: this.stamp });
  }

  update(targets) {
    for (const [name, { position, on }] of Object.entries(targets)) {
      const row = this.rows.get(name);
      row.on.checked = on;
      row.inputs.forEach((input, k) => input.show(position[k]));
    }
  }
}

class ObstacleRows {
  constructor(robot, send) {
    this.send = send;
    this.kinds = robot.kinds;
    this.rows = new Map();
    this.list = document.getElementById("obstacles");
    this.list.replaceChildren();
    document.getElementById("add").replaceChildren(...Object.keys(robot.kinds).map((kind) => {
      const button = make("button", { type: "button", name: `add-${kind}` }, `+ ${kind}`);
      button.addEventListener("click", () => send({ do: "add", kind }));
      return button;
    }));
  }

  row({ name, kind }) {
    const labels = this.kinds[kind] ?? [];
    const change = (key, inputs) => () => {
      const values = inputs.map((input) => input.valueAsNumber);
      if (values.every(Number.isFinite)) this.send({ do: "change", name, [key]: values });
    };
    const position = [], size = [];
    AXES.forEach((axis) => position.push(numberInput(`${name} ${axis} [m]`, 0.01, () => change("position", position)())));
    labels.forEach((label) => size.push(numberInput(`size of ${name}: ${label} [m]`, 0.01, () => change("size", size)())));
    size.forEach((input) => (input.min = "0.005"));
    const remove = make("button", { type: "button", ariaLabel: `Remove ${name}`, title: "Remove" }, "✕");
    remove.addEventListener("click", () => this.send({ do: "remove", name }));
    const color = make("input", { type: "color", ariaLabel: `Color of ${name}`, title: "Color" });
    color.addEventListener("input", () => {
      const channels = [1, 3, 5].map((at) => parseInt(color.value.slice(at, at + 2), 16) / 255);
      this.send({ do: "change", name, color: channels });
    });
    const row = make(
      "div", { className: "thing block" },
      make("span", { className: "name" }, remove, color, make("span", {}, name)), ...position,
    );
    row.dataset.name = name;
    if (labels.length) {
      const blanks = Array.from({ length: 3 - size.length }, () => make("span"));
      row.append(make("span", { className: "label" }, labels.length === 3 ? "size" : labels.join(", ")), ...size, ...blanks);
    }
    return { row, kind, position, size, color };
  }

  update(things) {
    const names = new Set(things.map((thing) => thing.name));
    for (const [name, { row }] of this.rows) {
      if (names.has(name)) continue;
      row.remove();
      this.rows.delete(name);
    }
    for (const thing of things) {
      if (this.rows.get(thing.name)?.kind !== thing.kind) {
        this.rows.get(thing.name)?.row.remove();
        const made = this.row(thing);
        this.rows.set(thing.name, made);
        this.list.append(made.row);
      }
      const { position, size, color } = this.rows.get(thing.name);
      const shade = `#${thing.color.map((part) => Math.round(255 * part).toString(16).padStart(2, "0")).join("")}`;
      if (document.activeElement !== color && color.value !== shade) color.value = shade;
      position.forEach((input, k) => input.show(thing.position[k]));
      size.forEach((input, k) => input.show(thing.size[k]));
    }
  }
}
