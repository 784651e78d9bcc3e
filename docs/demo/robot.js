// A robot that MuJoCo simulates and a network drives. scripts/demo.py does the same in Python.

const PERIOD = 0.01; // s, between points of a reference
const SETTLE = 8.0; // s, in which a robot comes to rest where its reference begins

const clipped = (value, least, most) => Math.min(Math.max(value, least), most);

/** Outputs of a network: scaled inputs, layers with tanh but for the last one, scaled outputs. */
export function evaluated(network, inputs) {
  const [low, high] = network.inputs;
  let values = inputs.map((x, i) => (2 * (x - low[i])) / (high[i] - low[i]) - 1);
  network.weights.forEach((weights, layer) => {
    const sums = weights.map((row, j) =>
      row.reduce((sum, weight, i) => sum + weight * values[i], network.biases[layer][j]));
    values = layer < network.weights.length - 1 ? sums.map(Math.tanh) : sums;
  });
  const [least, most] = network.outputs;
  return values.map((x, i) => least[i] + ((x + 1) / 2) * (most[i] - least[i]));
}

export class Robot {
  /** A robot of robots.json, at rest where its reference begins. */
  constructor(mujoco, told) {
    this.mujoco = mujoco;
    this.told = told;
    this.network = told.network;
    const file = `/${told.name}.xml`;
    mujoco.FS.writeFile(file, told.xml);
    this.model = mujoco.MjModel.from_xml_path(file);
    this.data = new mujoco.MjData(this.model);
    this.timestep = this.model.opt.timestep;
    this.every = Math.round(this.network.every / this.timestep);
    this.driven = true; // by the network; else by whoever sets `controls`
    this.reset();
  }

  reset() {
    this.mujoco.mj_resetData(this.model, this.data);
    this.input = [...(this.told.input ?? [])];
    this.integral = [0, 0];
    this.controls = [...this.told.start];
    this.data.ctrl.set(this.controls);
    while (this.data.time < SETTLE) this.mujoco.mj_step(this.model, this.data);
    this.begun = this.data.time;
    this.steps = 0;
  }

  /** Time [s] since the reference began. */
  get time() {
    return this.data.time - this.begun;
  }

  /** The tip [m], x, y and z. */
  get tip() {
    return Array.from(this.data.sensordata.slice(0, 3));
  }

  /** Point [m] of the reference in its two axes at a time [s]. */
  reference(time) {
    const { approach, lap } = this.told.reference;
    const point = (k) => (k < approach.length ? approach[k] : lap[(k - approach.length) % lap.length]);
    const at = time / PERIOD, below = Math.floor(at);
    const [from, to] = [point(below), point(below + 1)];
    return from.map((x, i) => x + (at - below) * (to[i] - x));
  }

  /** Distance [m] of the tip from its reference. */
  get error() {
    const tip = this.tip, place = this.reference(this.time);
    return Math.hypot(...this.told.axes.map((axis, i) => tip[axis] - place[i]));
  }

  /** What the network sets: tensions [N] or lengths [m]. */
  decided() {
    const { kind, every, limit, integral, proportional } = this.network;
    const tip = this.told.axes.map((axis) => this.data.sensordata[axis]);
    if (kind === "places") {
      const place = this.reference(this.time);
      const error = place.map((x, i) => x - tip[i]);
      this.integral = this.integral.map((sum, i) => clipped(sum + integral * every * error[i], -limit, limit));
      const shift = error.map((e, i) => clipped(proportional * e + this.integral[i], -limit, limit));
      return evaluated(this.network, place.map((x, i) => x + shift[i]));
    }
    this.input = evaluated(this.network, [...tip, ...this.reference(this.time + every), ...this.input]);
    return this.controls.map((_, j) =>
      Math.max(this.input.reduce((sum, u, i) => sum + u * this.told.pulls[i][j], 0), 0));
  }

  /** A timestep, and a decision before it where one is due. */
  step() {
    if (this.driven && this.steps % this.every === 0) this.controls = this.decided();
    this.data.ctrl.set(this.controls);
    this.steps += 1;
    this.mujoco.mj_step(this.model, this.data);
  }

  /** Push the tip by a force [N], x, y and z, until it is called again. */
  push(force) {
    const last = 6 * (this.model.nbody - 1);
    force.forEach((f, i) => { this.data.xfrc_applied[last + i] = f; });
  }

  /** Middles of the robot from the base to the tip, each with its axes: [x, y, z, nine numbers]. */
  links() {
    const { xpos, xmat } = this.data, found = [];
    for (let i = 1; i < this.model.nbody; i += 1) {
      found.push([...xpos.slice(3 * i, 3 * i + 3), ...xmat.slice(9 * i, 9 * i + 9)]);
    }
    const axes = found.length ? found[found.length - 1].slice(3) : [1, 0, 0, 0, 1, 0, 0, 0, 1];
    return [[0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1], ...found, [...this.tip, ...axes]];
  }
}
