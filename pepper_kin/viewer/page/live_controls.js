"use strict";
// Small helpers for controls that several people move at once, and the panel's joints, layers and message.

// Make an element: make("button", { type: "button" }, "text", child, ...).
function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

// Show what the server says, unless somebody is moving or typing into this very control.
function showValue(input, value) {
  if (input.dataset.edited || performance.now() - (input.touched ?? -Infinity) < 400) return;
  if (input.type === "checkbox") input.checked = value;
  else if (input.value === "" || Number(input.value) !== value) input.value = value;
}

// A number to type: sent when the typing is done, or at each step of the arrow keys.
function numberInput(label, step, onChange) {
  const input = make("input", { type: "number", step: String(step), ariaLabel: label, title: label });
  input.addEventListener("input", () => (input.dataset.edited = "1"));
  input.addEventListener("blur", () => delete input.dataset.edited);
  input.addEventListener("change", () => {
    delete input.dataset.edited;
    if (input.value !== "" && Number.isFinite(input.valueAsNumber)) onChange(input.valueAsNumber);
  });
  return input;
}

class Joints {
  constructor(robot, send) {
    const list = document.getElementById("joints");
    list.replaceChildren();
    this.rows = robot.joints.map((joint) => {
      const slider = make("input", {
        type: "range", id: joint.name, name: joint.name, min: joint.lower, max: joint.upper, step: "any",
      });
      const value = make("output", { htmlFor: joint.name });
      slider.addEventListener("input", () => {
        slider.touched = performance.now();
        send({ do: "joint", name: joint.name, value: slider.valueAsNumber });
        this.read(value, slider.valueAsNumber, joint);
      });
      const range = make(
        "div", { className: "range" }, make("span", {}, Axes.fixed(joint.lower, 2)), slider,
        make("span", {}, Axes.fixed(joint.upper, 2)),
      );
      const row = make("div", { className: "joint" }, make("label", { htmlFor: joint.name }, joint.name), value, range);
      list.append(row);
      return { joint, slider, value, row };
    });
    const postures = document.getElementById("postures");
    postures.replaceChildren(...robot.postures.map((name) => {
      const button = make("button", { type: "button", name: `posture-${name}` }, name);
      button.addEventListener("click", () => send({ do: "posture", name }));
      return button;
    }));
    this.chooseGroup(robot.groups);
  }

  chooseGroup(groups) {
    const select = document.getElementById("group");
    const chosen = select.value || "all";
    const options = ["all", ...Object.keys(groups).filter((name) => name !== "whole_body")];
    select.replaceChildren(...options.map((name) => make("option", { value: name }, name.replaceAll("_", " "))));
    select.value = options.includes(chosen) ? chosen : "all";
    const show = () => this.rows.forEach(({ joint, row }) => {
      row.hidden = select.value !== "all" && !groups[select.value].includes(joint.name);
    });
    select.onchange = show;
    show();
  }

  read(output, value, joint) {
    const degrees = joint.unit === "rad" ? ` (${Axes.fixed((value * 180) / Math.PI, 0)}°)` : "";
    const text = `${Axes.fixed(value, 3)} ${joint.unit}${degrees}`;
    if (output.textContent !== text) output.textContent = text;
  }

  update(q) {
    this.rows.forEach(({ joint, slider, value }, k) => {
      showValue(slider, q[k]);
      this.read(value, q[k], joint);
    });
  }
}

class Layers {
  constructor(robot, send) {
    this.boxes = new Map();
    document.getElementById("layers").replaceChildren(...robot.layers.map(({ name, title }) => {
      const box = make("input", { type: "checkbox", id: `show-${name}` });
      box.addEventListener("change", () => send({ do: "show", layer: name, on: box.checked }));
      this.boxes.set(name, box);
      return make("label", { className: "switch" }, box, title);
    }));
  }

  update(shown) {
    for (const [name, on] of Object.entries(shown)) this.boxes.get(name).checked = on;
  }
}

// Warnings of what is so now: contact, torque, balance.
function showAlerts(alerts) {
  const list = document.getElementById("alerts");
  list.replaceChildren(...alerts.map(({ kind, text }) => make("li", { className: kind }, text)));
}

// The message line: what the server says to all, how it refused this page's last command, or what it is busy with.
const messageLine = {
  said: { text: "", kind: "info" },
  busy: null,

  // Take another `said` or `busy`.
  update(change) {
    Object.assign(this, change);
    const { text, kind } = this.busy ? { text: this.busy, kind: "info" } : this.said;
    const line = document.getElementById("message");
    if (line.textContent !== text) line.textContent = text;
    line.className = kind;
  },
};
