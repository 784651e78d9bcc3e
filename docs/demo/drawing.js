// Draws a robot on a canvas, seen from far away: drag to turn, wheel to come nearer.

const TRAIL = 5; // s
const COLOURS = { body: "#cfd8e3", edge: "#9fb0c3", reference: "#1d2733", trail: "#d55e00", tip: "#d55e00", grid: "#e3e8ee" };
const VIEWS = { arm: { turn: 0, tilt: 0, look: [0, 0, 0.24], wide: 1.1 }, rig: { turn: 0.6, tilt: 0.8, look: [0, 0, 0.1], wide: 0.42 } };
const SLACK = [70, 130, 180], TAUT = [213, 94, 0]; // colours of tendons

const mixed = (share) => `rgb(${SLACK.map((x, i) => Math.round(x + share * (TAUT[i] - x))).join(",")})`;

export class Scene {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.trail = [];
    let held = null;
    canvas.addEventListener("pointerdown", (event) => { held = event; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointerup", () => { held = null; });
    canvas.addEventListener("pointermove", (event) => {
      if (!held) return;
      this.view.turn += 0.008 * (event.clientX - held.clientX);
      this.view.tilt = Math.min(Math.max(this.view.tilt + 0.008 * (event.clientY - held.clientY), -0.2), 1.5);
      held = event;
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.view.wide = Math.min(Math.max(this.view.wide * Math.exp(0.001 * event.deltaY), 0.1), 4);
    }, { passive: false });
  }

  /** Look at a robot anew. */
  begin(robot) {
    this.view = { ...VIEWS[robot.told.name] };
    this.trail = [];
    const [first, second] = robot.told.axes, upright = robot.tip;
    this.lap = robot.told.reference.lap.map((place) => {
      const point = [...upright];
      [point[first], point[second]] = place;
      // A beam bent like an arc is lower by two thirds of this, to the second order.
      if (second === 1) point[2] -= (2 / 3) * Math.hypot(...place) ** 2 / upright[2];
      return point;
    });
  }

  /** Keep where the tip is. */
  remember(robot) {
    this.trail.push({ time: robot.time, tip: robot.tip });
    while (this.trail[0].time < robot.time - TRAIL) this.trail.shift();
  }

  draw(robot) {
    const { canvas, context } = this, ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== width * ratio || canvas.height !== height * ratio) {
      [canvas.width, canvas.height] = [width * ratio, height * ratio];
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    this.scale = Math.min(width, 1.4 * height) / this.view.wide;
    this.middle = [width / 2, height / 2];
    this.floor(robot);
    this.line(this.lap, { colour: COLOURS.reference, width: 1.5, dash: [6, 5], closed: robot.told.name === "rig" });
    this.line(this.trail.map((one) => one.tip), { colour: COLOURS.trail, width: 2 });
    const links = robot.links(), along = links.map((link) => link.slice(0, 3));
    const thick = 2 * robot.told.radius * this.scale;
    this.line(along, { colour: COLOURS.edge, width: thick + 2, cap: "butt" });
    this.line(along, { colour: COLOURS.body, width: thick, cap: "butt" });
    this.tendons(robot, links);
    this.dot(robot.tip, 5, COLOURS.tip);
    const goal = [...robot.tip], place = robot.reference(robot.time);
    robot.told.axes.forEach((axis, i) => { goal[axis] = place[i]; });
    this.ring(goal, 8, COLOURS.reference);
    this.legend(robot, width, height);
  }

  /** Where a point [m] is on the canvas. */
  place([x, y, z]) {
    const { turn, tilt, look } = this.view;
    const [a, b, c] = [x - look[0], y - look[1], z - look[2]];
    const right = Math.cos(turn) * a + Math.sin(turn) * b;
    const away = -Math.sin(turn) * a + Math.cos(turn) * b;
    const up = Math.cos(tilt) * c + Math.sin(tilt) * away;
    return [this.middle[0] + this.scale * right, this.middle[1] - this.scale * up];
  }

  line(points, { colour, width = 1, dash = [], cap = "round", closed = false }) {
    if (points.length < 2) return;
    const { context } = this, places = points.map((point) => this.place(point));
    context.beginPath();
    context.moveTo(...places[0]);
    // Rounded at each point, between the middles to the points before and after it.
    places.slice(1, -1).forEach(([x, y], k) => {
      const [nextX, nextY] = places[k + 2];
      context.quadraticCurveTo(x, y, (x + nextX) / 2, (y + nextY) / 2);
    });
    context.lineTo(...places[places.length - 1]);
    if (closed) context.closePath();
    Object.assign(context, { strokeStyle: colour, lineWidth: width, lineJoin: "round", lineCap: cap });
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  }

  dot(point, radius, colour) {
    const { context } = this;
    context.beginPath();
    context.arc(...this.place(point), radius, 0, 2 * Math.PI);
    context.fillStyle = colour;
    context.fill();
  }

  ring(point, radius, colour) {
    const { context } = this;
    context.beginPath();
    context.arc(...this.place(point), radius, 0, 2 * Math.PI);
    Object.assign(context, { strokeStyle: colour, lineWidth: 1.5 });
    context.stroke();
  }

  floor(robot) {
    const step = robot.told.length > 0.3 ? 0.1 : 0.05, reach = 8 * step;
    for (let k = -8; k <= 8; k += 1) {
      this.line([[k * step, -reach, 0], [k * step, reach, 0]], { colour: COLOURS.grid });
      this.line([[-reach, k * step, 0], [reach, k * step, 0]], { colour: COLOURS.grid });
    }
  }

  /** Tendons beside the backbone up to where they end, coloured by their tension. */
  tendons(robot, links) {
    const tensions = robot.data.actuator_force, most = this.largest(robot);
    let passed = 0;
    const stations = links.map((link, k) => {
      if (k) passed += Math.hypot(...[0, 1, 2].map((i) => link[i] - links[k - 1][i]));
      return passed;
    });
    robot.told.tendons.forEach(({ offset, end }, j) => {
      const path = links.filter((_, k) => stations[k] <= end * 1.02 + 1e-3).map((link) =>
        [0, 1, 2].map((i) => link[i] + link[3 + 3 * i] * offset[0] + link[4 + 3 * i] * offset[1]));
      const share = Math.min(Math.abs(tensions[j]) / most, 1);
      this.line(path, { colour: mixed(share), width: 1.5 + 2.5 * share });
      if (path.length) this.dot(path[path.length - 1], 2.5, mixed(share));
    });
  }

  /** Tension [N] of the fullest colour. */
  largest(robot) {
    return robot.told.unit === "N" ? 20 : 15;
  }

  legend(robot, width, height) {
    const { context } = this, long = robot.told.length > 0.3 ? 0.1 : 0.05;
    const left = 24, low = height - 28;
    context.font = "13px system-ui, sans-serif";
    context.textAlign = "left";
    Object.assign(context, { strokeStyle: "#1d2733", fillStyle: "#1d2733", lineWidth: 2 });
    context.beginPath();
    context.moveTo(left, low);
    context.lineTo(left + long * this.scale, low);
    context.stroke();
    context.fillText(`${(1000 * long).toFixed(0)} mm`, left, low - 8);
    const bar = { x: width - 180, y: low - 4, w: 130, h: 8 };
    const shade = context.createLinearGradient(bar.x, 0, bar.x + bar.w, 0);
    shade.addColorStop(0, mixed(0));
    shade.addColorStop(1, mixed(1));
    context.fillStyle = shade;
    context.fillRect(bar.x, bar.y, bar.w, bar.h);
    context.fillStyle = "#1d2733";
    context.fillText("tension", bar.x, bar.y - 8);
    context.textAlign = "right";
    context.fillText(`${this.largest(robot)} N`, bar.x + bar.w, bar.y - 8);
    context.textAlign = "left";
    context.fillText("dashed: reference", left, 30);
    context.fillStyle = COLOURS.trail;
    context.fillText("tip, the last 5 seconds", left, 50);
  }
}
