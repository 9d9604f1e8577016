"use strict";
// The timeline of a planned or loaded motion.
class Timeline {
  constructor(send) {
    const element = (id) => document.getElementById(id);
    Object.assign(this, { send, motion: null, state: null });
    [this.bar, this.button, this.scrub, this.clock, this.speed, this.loop] =
      ["timeline", "play", "scrub", "clock", "speed", "loop"].map(element);
    this.button.onclick = () => this.toggle();
    this.scrub.oninput = () => {
      this.scrub.touched = performance.now();
      if (this.state?.playing) send({ do: "pause" });
      send({ do: "seek", time: this.scrub.valueAsNumber });
    };
    this.speed.onchange = () => send({ do: "speed", value: Number(this.speed.value) });
    this.loop.onclick = () => send({ do: "loop", on: !this.state?.loop });
    element("clear").onclick = () => send({ do: "clear" });
    document.onkeydown = (event) => {
      if (event.key !== " " || this.bar.hidden || event.target.closest("button, select, input, summary")) return;
      event.preventDefault();
      this.toggle();
    };
  }

  toggle() {
    this.send({ do: this.state?.playing ? "pause" : "play" });
  }

  setMotion(motion) {
    this.motion = motion;
    this.bar.hidden = motion === null;
    if (motion) [this.scrub.min, this.scrub.max] = [motion.start, motion.end];
  }

  update(state) {
    this.state = state;
    if (!state || !this.motion) return;
    showValue(this.scrub, state.time);
    this.clock.replaceChildren(make("b", {}, state.time.toFixed(2)), ` / ${this.motion.end.toFixed(2)} s`);
    this.button.classList.toggle("playing", state.playing);
    this.button.ariaLabel = state.playing ? "Pause" : "Play";
    this.loop.ariaPressed = String(state.loop);
    const option = [...this.speed.options].find((choice) => Number(choice.value) === state.speed);
    if (option) option.selected = true;
  }
}
