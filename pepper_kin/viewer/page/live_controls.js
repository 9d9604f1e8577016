"use strict";
// Small helpers for controls that several people move at once, and the panel's joints, layers and message.

// Make an element: make("button", { type: "button" }, "text", child, ...).
function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

// Show what the server says; while somebody moves this very slider, once that is over.
function showValue(input, value) {
  clearTimeout(input.later);
  const left = 400 - (performance.now() - (input.touched ?? -Infinity));
  if (left > 0) input.later = setTimeout(() => showValue(input, value), left);
  else if (input.value === "" || Number(input.value) !== value) input.value = value;
}

// Digits after the point, how near [m] a number is the same, how long a field counts as typed into after the last key,
// and how long an answer may take [ms].
const NUMBER = { digits: 3, same: 0.6e-3, typing: 3000, answer: 3000 };

// A number to type: sent when the typing is done, or at each step of the arrow keys.  What the server says is shown
// by its method `show`, but not while somebody types, nor between sending a number and the server's taking it over:
// a message that was on its way meanwhile holds the number before.
function numberInput(label, step, onChange) {
  const input = make("input", { type: "number", step: String(step), ariaLabel: label, title: label });
  const state = { latest: null, sent: null, edited: false, used: -Infinity, timer: 0 };

  function settle() {
    clearTimeout(state.timer);
    if (state.latest === null || state.edited || state.sent !== null) return;
    const left = document.activeElement === input ? NUMBER.typing - (performance.now() - state.used) : 0;
    const text = Axes.fixed(state.latest, NUMBER.digits);
    if (left > 0) state.timer = setTimeout(settle, left);
    else if (input.value !== text) input.value = text;
  }

  input.show = (value) => {
    state.latest = value;
    if (state.sent !== null && Math.abs(value - state.sent) <= NUMBER.same) state.sent = null;
    settle();
  };
  for (const type of ["focus", "keydown", "pointerdown"]) {
    input.addEventListener(type, () => (state.used = performance.now()));
  }
  input.addEventListener("input", () => (state.edited = true));
  input.addEventListener("blur", () => {
    state.edited = false;
    settle();
  });
  input.addEventListener("change", () => {
    state.edited = false;
    const value = input.valueAsNumber;
    if (!Number.isFinite(value)) {
      settle();
      return;
    }
    state.sent = value;
    onChange(value);
    // A number that is refused, or changed, comes back as it was, or never.
    setTimeout(() => {
      if (state.sent !== value) return;
      state.sent = null;
      settle();
    }, NUMBER.answer);
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
  list.replaceChildren(...alerts.map(({ kind, text }) => make("div", { className: kind }, text)));
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
