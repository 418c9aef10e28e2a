// Side view (table, object, hand, arm, forces), slip ruler and taxels. In millimetres; heights count
// upwards from the grasp, SVG coordinates downwards.

const MM = 1000;
const FORCE_MM = 5; // length of an arrow per newton
const SLIPPING_MPS = 0.003; // the paper's threshold of slip
const PAD_MM = 8; // thick, as drawn
const SIDE = [-1, 1, 1]; // of the object, where the thumb, B and C are
const APART_MM = [0, -6, 6]; // B hides C in this view: their arrows are drawn one above the other
const LIVE_SLIP_M = 0.1; // range of the ruler for a run in progress
const PALM_MM = 105, ARM_MM = 70; // height of the palm above the pads, and of the arm above it, as drawn

function makeScene(series) {
  if (!data.scene) return () => {};
  const scene = data.scene, body = scene.object;
  const known = "height" in series;
  const half = body.half_width_m * MM;
  const round = body.shape === "ellipsoid";
  const below = round ? (body.half_height_m + body.grip_height_m) * MM : Math.min(80, body.body_above_grip_m * MM);
  const above = round ? (body.half_height_m - body.grip_height_m) * MM : body.body_above_grip_m * MM;
  const palm = Math.max(PALM_MM, above + 14); // the object stands below it
  const top = (scene.top_m - scene.grip_m) * MM + palm + ARM_MM;
  const wide = Math.max(150, half + PAD_MM + data.limit_n * FORCE_MM + 52); // with room for the labels of the arrows

  const root = document.getElementById("scene");
  root.replaceChildren();
  set(root, {viewBox: `${-wide} ${-top} ${2 * wide} ${top + below + 24}`});
  const table = svg("g", {class: "table"}, root);
  svg("line", {x1: -wide, x2: wide, y1: below, y2: below}, table);
  for (let x = -wide; x < wide; x += 10) svg("line", {x1: x, x2: x - 8, y1: below + 8, y2: below, class: "hatch"}, table);

  const thing = svg("g", {class: "object"}, root);
  if (known) drawBody(thing, round, half, above, below, body);

  const hand = svg("g", {class: "hand"}, root);
  svg("rect", {x: -14, width: 28, y: -top, height: top - palm}, hand);
  svg("rect", {x: -48, width: 96, y: -palm - 26, height: 26, rx: 6}, hand);
  const fingers = SIDE.map((side, i) => drawFinger(hand, side, i, scene.pad_half_m * MM, palm));
  drawScale(root, wide, below, FORCE_MM);

  return (i) => {
    const up = (series.arm[0][i] - scene.grip_m) * MM;
    if (Number.isFinite(up)) set(hand, {transform: `translate(0 ${-up})`});
    if (known) {
      const slipping = Math.abs(series.slip_speed[0][i]) > SLIPPING_MPS;
      set(thing, {transform: `translate(0 ${-series.height[0][i] * MM})`, class: slipping ? "object slipping" : "object"});
    }
    fingers.forEach((finger, f) => {
      const reach = (scene.half_aperture_m - series.positions[f][i] * scene.m_per_count) * MM;
      const pads = known ? Math.max(reach, half - PAD_MM / 2) : reach; // a compressed pad is not drawn inside the object
      finger(pads, series.estimated[f][i], known ? series.true[f][i] : null, known ? series.shear[f][i] : null);
    });
  };
}

function drawBody(thing, round, half, above, below, body) {
  if (round) {
    const centre = body.grip_height_m * MM;
    svg("ellipse", {cx: 0, cy: centre, rx: half, ry: body.half_height_m * MM, class: "body"}, thing);
  } else {
    svg("rect", {x: -half, width: 2 * half, y: -above, height: above + below, rx: 2, class: "body"}, thing);
  }
  svg("line", {x1: -half, x2: half, y1: 0, y2: 0, class: "mark"}, thing); // where it was grasped first
}

// Draws one finger; returns a function that moves it to a distance from the middle, with forces in newtons.
function drawFinger(hand, side, index, padHalf, palm) {
  const group = svg("g", {class: `finger finger${index}`}, hand);
  const link = svg("polyline", {class: "link"}, group);
  const pad = svg("rect", {width: PAD_MM, y: -padHalf, height: 2 * padHalf, rx: 3, class: "pad"}, group);
  const y = APART_MM[index];
  const estimated = svg("path", {class: "estimated"}, group), limit = svg("path", {class: "limit"}, group);
  const arrow = svg("path", {class: "true"}, group), share = svg("path", {class: "share"}, group);
  const label = svg("text", {"text-anchor": side < 0 ? "end" : "start"}, group);
  const most = data.limit_n * FORCE_MM;
  return (reach, estimatedN, trueN, shearN) => {
    const x = side * reach, back = x + side * PAD_MM;
    set(pad, {x: side < 0 ? x - PAD_MM : x});
    set(link, {points: `${side * 40},${-palm} ${side * (reach + 30)},${-0.6 * palm} ${back},${-padHalf / 2}`});
    set(estimated, {d: Number.isFinite(estimatedN) ? `M${back} ${y - 2.5}h${side * estimatedN * FORCE_MM}v5H${back}z` : ""});
    set(limit, {d: `M${back + side * most} ${y - 5}v10`});
    set(arrow, {d: trueN === null ? "" : arrowPath(back, y, side, trueN * FORCE_MM)});
    set(share, {d: shearN === null ? "" : risePath(x - side * 4, y, -shearN * FORCE_MM)});
    const shown = trueN === null ? estimatedN : trueN;
    const end = back + side * (Math.max(most, shown * FORCE_MM || 0) + 4);
    set(label, {x: end, y: y * 1.4 + 4});
    label.textContent = Number.isFinite(shown) ? `${data.fingers[index]} ${shown.toFixed(1)}` : data.fingers[index];
  };
}

// An arrow towards the object, its length the force; a short one is only a head.
function arrowPath(x, y, side, length) {
  if (!(length > 0.5)) return "";
  const head = Math.min(6, length);
  return `M${x} ${y}l${side * head} -4v8zM${x + side * head} ${y - 1}H${x + side * length}v2H${x + side * head}z`;
}

function risePath(x, y, length) {
  if (!(Math.abs(length) > 0.5)) return "";
  const head = Math.sign(length) * Math.min(5, Math.abs(length));
  return `M${x - 0.8} ${y}v${length - head}h-2.2l3 ${head} 3 ${-head}h-2.2V${y}z`;
}

function drawScale(root, wide, below, perNewton) {
  const y = below + 16, x = -wide + 8;
  svg("path", {d: `M${x} ${y - 3}v6M${x} ${y}h${10 * perNewton}m0 -3v6`, class: "scale"}, root);
  svg("text", {x: x + 10 * perNewton + 4, y: y + 4, class: "scale"}, root, "10 N");
  svg("path", {d: `M${wide - 104} ${y - 3}v6M${wide - 104} ${y}h50m0 -3v6`, class: "scale"}, root);
  svg("text", {x: wide - 50, y: y + 4, class: "scale"}, root, "50 mm");
}

// The object's surface as a ruler that moves past a pad, enlarged four times.
function makeRuler(series) {
  const root = document.getElementById("ruler");
  if (!root) return () => {};
  root.replaceChildren();
  const furthest = data.live ? LIVE_SLIP_M : Math.max(...series.slip[0]);
  const zoom = 4, tall = 100, most = Math.ceil(furthest * MM) + 15;
  set(root, {viewBox: `0 0 200 ${tall}`});
  const surface = svg("g", {class: "surface"}, root);
  svg("rect", {x: 70, width: 130, y: -(most + 15) * zoom, height: (most + 30) * zoom}, surface);
  for (let mm = -15; mm <= most; mm++) {
    const length = mm % 10 === 0 ? 26 : mm % 5 === 0 ? 18 : 9;
    svg("line", {x1: 70, x2: 70 + length, y1: -mm * zoom, y2: -mm * zoom}, surface);
    if (mm % 5 === 0) svg("text", {x: 102, y: -mm * zoom + 4}, surface, `${mm}`);
  }
  svg("rect", {x: 40, width: 30, y: tall / 2 - 40, height: 80, rx: 6, class: "pad"}, root);
  svg("path", {d: `M70 ${tall / 2}l-10 -6v12z`, class: "pointer"}, root);
  const label = svg("text", {x: 132, y: 20, class: "reading"}, root);
  return (i) => {
    const mm = series.slip[0][i] * MM, speed = series.slip_speed[0][i];
    const slipping = Math.abs(speed) > SLIPPING_MPS;
    set(surface, {transform: `translate(0 ${tall / 2 + mm * zoom})`, class: slipping ? "surface slipping" : "surface"});
    label.textContent = slipping ? `${(speed * MM).toFixed(0)} mm/s` : "";
  };
}

// The taxels of each fingertip as rectangles, darker with more pressure.
function makeTaxels(series) {
  const places = data.taxels;
  const columns = 1 + Math.max(...places.map((p) => p[0])), rows = 1 + Math.max(...places.map((p) => p[1]));
  const counts = series.counts;
  let deepest = Math.max(50, ...counts.map((values) => values.reduce((most, v) => (-v > most ? -v : most), 0)));
  const cells = data.fingers.map((finger) => {
    const root = document.getElementById(`taxels-${finger}`);
    root.replaceChildren();
    set(root, {viewBox: `0 0 ${columns * 34} ${rows * 20}`});
    return places.map(([column, row]) => {
      const x = column * 34, y = (rows - 1 - row) * 20;
      svg("rect", {x: x + 1, y: y + 1, width: 32, height: 18, rx: 2, class: "cell"}, root);
      const heat = svg("rect", {x: x + 1, y: y + 1, width: 32, height: 18, rx: 2, class: "heat"}, root);
      return [heat, svg("text", {x: x + 17, y: y + 14}, root)];
    });
  });
  return (i) => cells.forEach((finger, f) => finger.forEach(([heat, text], taxel) => {
    const count = counts[f * places.length + taxel][i];
    if (-count > deepest) deepest = -count;
    const depth = Math.min(1, Math.max(0, -count / deepest)) || 0;
    set(heat, {"fill-opacity": depth.toFixed(2)});
    set(text, {class: depth > 0.55 ? "deep" : ""});
    text.textContent = Number.isFinite(count) ? `${Math.round(count)}` : "–";
  }));
}
