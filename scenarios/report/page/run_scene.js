// The view in perspective (table, object, hand, arm, forces), slip ruler and taxels. In millimetres: x along
// the closing axis with the thumb at its negative end, y from finger B to C, z upwards from the grasp.

const MM = 1000;
const FORCE_MM = 5; // length of an arrow per newton
const SLIPPING_MPS = 0.003; // the paper's threshold of slip
const PAD_MM = 8; // thick, as drawn
const SIDE = [-1, 1, 1]; // of the object, where the thumb, B and C are
const BESIDE_MM = [0, -17, 17]; // the fingers' y, as drawn
const LIVE_SLIP_M = 0.1; // range of the ruler for a run in progress
const PALM_MM = 105, ARM_MM = 70; // height of the palm above the pads, and of the arm above it, as drawn
const TABLE_MM = 140, EYE_MM = 1500; // half a side of the drawn table, distance of the eye
const FIRST_VIEW = {yaw: -0.45, pitch: 0.22}; // rad
const LABEL_PX = [60, 14]; // distances at which the names of two fingers are apart
const DRAG_RAD = 0.01, KEY_RAD = 0.1; // turned per pixel and per key
const LIGHT = [-0.45, -0.5, 0.74]; // in the eye's frame: right, away, up

const view = {...FIRST_VIEW};
let redrawScene = () => {};

function turnScene(yaw, pitch) {
  view.yaw += yaw;
  view.pitch = Math.min(1.5, Math.max(0, view.pitch + pitch)); // never from below the table
  redrawScene();
}

function listenToScene(canvas) {
  let from = null;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    from = [event.clientX, event.clientY];
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    turnScene((event.clientX - from[0]) * DRAG_RAD, (event.clientY - from[1]) * DRAG_RAD);
    from = [event.clientX, event.clientY];
  });
  canvas.addEventListener("keydown", (event) => {
    const turns = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}[event.key];
    if (!turns || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation(); // elsewhere these keys step through the samples
    turnScene(turns[0] * KEY_RAD, turns[1] * KEY_RAD);
  });
  document.getElementById("unturn").addEventListener("click", () => {
    Object.assign(view, FIRST_VIEW);
    redrawScene();
  });
  new ResizeObserver(() => redrawScene()).observe(canvas);
}
listenToScene(document.getElementById("scene"));

function makeScene(series) {
  if (!data.scene) return () => {};
  const scene = data.scene, body = scene.object, canvas = document.getElementById("scene");
  const known = "height" in series;
  const half = body.half_width_m * MM;
  const round = body.shape === "ellipsoid";
  const below = round ? (body.half_height_m + body.grip_height_m) * MM : Math.min(80, body.body_above_grip_m * MM);
  const above = round ? (body.half_height_m - body.grip_height_m) * MM : body.body_above_grip_m * MM;
  const rings = Array.from({length: 15}, (_, k) => {
    const z = -below + (above + below) * k / 14;
    return [z, round ? half * Math.sqrt(Math.max(0, 1 - ((z + body.grip_height_m * MM) / (body.half_height_m * MM)) ** 2)) : half];
  });
  const palm = Math.max(PALM_MM, above + 14); // the object stands below it
  const top = (scene.top_m - scene.grip_m) * MM + palm + ARM_MM;
  const wide = Math.max(150, half + PAD_MM + data.limit_n * FORCE_MM + 40); // with room for the labels of the arrows
  let up = 0, shown = 0;

  function draw() {
    const i = shown, paint = painter(canvas, wide, -below - 60, top);
    const risen = (series.arm[0][i] - scene.grip_m) * MM;
    if (Number.isFinite(risen)) up = risen;
    paint.table(-below);
    const height = known ? series.height[0][i] * MM : NaN;
    if (Number.isFinite(height)) {
      const turn = series.turn[0][i] || 0, aside = (series.across[0][i] || 0) * MM;
      const slipping = Math.abs(series.slip_speed[0][i]) > SLIPPING_MPS;
      // in the hand it turns about the pads' centre
      const place = ([x, y, z]) => {
        const h = z + height - up;
        return [x, aside + y * Math.cos(turn) - h * Math.sin(turn), up + y * Math.sin(turn) + h * Math.cos(turn)];
      };
      paint.turned(rings, place, slipping ? "slipping" : "body");
      paint.ring(ringAt(0, half * 1.005).map(place), slipping ? "limit" : "soft"); // where it was grasped first
    }
    paint.block(box(-14, 14, -14, 14, up + palm, top + 40 + up), "metal");
    paint.block(box(-48, 48, -34, 34, up + palm, up + palm + 26), "metal");
    const forces = SIDE.map((side, f) => {
      const reach = (scene.half_aperture_m - series.positions[f][i] * scene.m_per_count) * MM;
      const pads = known ? Math.max(reach, half - PAD_MM / 2) : reach; // a compressed pad is not drawn inside the object
      const y = BESIDE_MM[f], x = side * (Number.isFinite(pads) ? pads : scene.half_aperture_m * MM), back = x + side * PAD_MM;
      const knee = [side * (Math.abs(x) + 34), y, up + 0.6 * palm], long = scene.pad_half_m * MM;
      paint.block(bar([side * 40, y, up + palm], knee), "metal");
      paint.block(bar(knee, [back + side * 4, y, up + long / 2]), "metal");
      paint.block(box(Math.min(x, back), Math.max(x, back), y - 9, y + 9, up - long, up + long), `finger${f}`);
      return {f, side, at: [back, y, up], pad: [x, y, up], estimated: series.estimated[f][i],
        force: known ? series.true[f][i] : NaN, shear: known ? series.shear[f][i] : NaN};
    });
    paint.finish();
    paint.labels(forces.map(paint.force));
    canvas.setAttribute("aria-label", describe(forces, height));
  }

  function describe(forces, height) {
    const object = Number.isFinite(height) ? `object ${height.toFixed(0)} mm above the table` : "object's position unknown";
    const each = forces.map(({f, force, estimated}) => [data.fingers[f], Number.isFinite(force) ? force : estimated]);
    const pressed = each.map(([name, n]) => `${name} ${Number.isFinite(n) ? `${n.toFixed(1)} N` : "unknown"}`).join(", ");
    const degrees = (rad) => (rad * 180 / Math.PI).toFixed(0);
    return `Hand ${up.toFixed(0)} mm above the place of the grasp, ${object}; forces ${pressed}. Seen from ${degrees(view.yaw)}° aside, ${degrees(view.pitch)}° above.`;
  }

  redrawScene = draw;
  return (i) => { shown = i; draw(); };
}

const ringAt = (z, r) => Array.from({length: 24}, (_, k) => [r * Math.cos(k * Math.PI / 12), r * Math.sin(k * Math.PI / 12), z]);

// Eight corners of a block: four of one end, then the opposite four.
const box = (x0, x1, y0, y1, z0, z1) => [z0, z1].flatMap((z) => [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]);

function bar(from, to) {
  const long = Math.hypot(to[0] - from[0], to[2] - from[2]) || 1;
  const nx = 4.5 * (to[2] - from[2]) / long, nz = -4.5 * (to[0] - from[0]) / long;
  return [from, to].flatMap(([x, y, z]) => [[1, -5], [1, 5], [-1, 5], [-1, -5]].map(([s, w]) => [x + s * nx, y + w, z + s * nz]));
}

const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));

// Draws faces from the furthest to the nearest; the whole width and height of the scene fit the canvas.
function painter(canvas, wide, bottom, top) {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight, c = canvas.getContext("2d");
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  c.scale(ratio, ratio);
  c.lineJoin = "round";
  const names = ["body", "metal", "soft", "grid", "limit", "ink", "card", "finger0", "finger1", "finger2"];
  const colours = Object.fromEntries(names.map((name) => [name, colour(name)]));
  const zoom = EYE_MM * Math.min(width / (2 * wide), height / (top - bottom)) * 0.94, middle = (top + bottom) / 2;
  const [sy, cy, sp, cp] = [Math.sin(view.yaw), Math.cos(view.yaw), Math.sin(view.pitch), Math.cos(view.pitch)];
  const faces = [];

  // right, away, up
  const seen = ([x, y, z]) => {
    const away = x * sy + y * cy, h = z - middle;
    return [x * cy - y * sy, away * cp - h * sp, h * cp + away * sp];
  };
  const flat = ([right, away, up]) => {
    const s = zoom / (EYE_MM + away);
    return [width / 2 + right * s, height / 2 - up * s];
  };
  const path = (points) => {
    c.beginPath();
    points.forEach((point) => c.lineTo(...flat(point)));
  };
  const line = (from, to, style, thick = 1) => {
    c.strokeStyle = style;
    c.lineWidth = thick;
    path([seen(from), seen(to)]);
    c.stroke();
  };

  function face(corners, name) {
    const points = corners.map(seen);
    const depth = points.reduce((sum, p) => sum + p[1], 0) / points.length;
    const [a, b, d] = [points[0], points[1], points[points.length - 1]];
    const [u, v] = [b.map((n, k) => n - a[k]), d.map((n, k) => n - a[k])];
    const normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    const facing = normal[1] > 0 ? -1 : 1; // the side that is seen
    const lit = facing * normal.reduce((sum, n, k) => sum + n * LIGHT[k], 0) / (Math.hypot(...normal) || 1);
    faces.push({points, depth, name, dark: 0.32 * (1 - Math.max(0, lit))});
  }

  function finish() {
    faces.sort((a, b) => b.depth - a.depth);
    for (const {points, name, dark, ring} of faces) {
      path(points);
      if (ring) {
        c.strokeStyle = colours[ring];
        c.lineWidth = 2;
        c.stroke();
        continue;
      }
      c.closePath();
      const own = rgb(colours[name === "slipping" ? "body" : name]), red = rgb(colours.limit), share = name === "slipping" ? 0.5 : 0;
      const mixed = own.map((n, k) => Math.round((n + share * (red[k] - n)) * (1 - dark)));
      c.fillStyle = c.strokeStyle = `rgb(${mixed})`;
      c.lineWidth = 0.7; // hides the seams
      c.fill();
      c.stroke();
    }
  }

  function force({f, side, at, pad, estimated, force: pressed, shear}) {
    const [x, y, z] = at, ink = colours[`finger${f}`], end = (n) => [x + side * n * FORCE_MM, y, z];
    if (estimated > 0) {
      line(at, end(estimated), ink, 8);
      line(at, end(estimated), colours.card, 5.5);
    }
    const most = end(data.limit_n);
    line([most[0], y, z - 7], [most[0], y, z + 7], colours.limit, 2);
    if (pressed > 0.1) {
      const head = Math.min(6, pressed * FORCE_MM);
      line([x + side * head, y, z], end(pressed), ink, 3);
      path([at, [x + side * head, y, z - 4], [x + side * head, y, z + 4]].map(seen));
      c.fillStyle = ink;
      c.fill();
    }
    if (Math.abs(shear) > 0.1) line([pad[0] - side * 3, y, z], [pad[0] - side * 3, y, z + shear * FORCE_MM], ink, 3);
    const shown = Number.isFinite(pressed) ? pressed : estimated;
    const [left, low] = flat(seen([x + side * (Math.max(data.limit_n, shown || 0) * FORCE_MM + 4), y, z]));
    const text = `${data.fingers[f]} ${Number.isFinite(shown) ? shown.toFixed(1) : ""}`;
    return {text, ink, align: side * cy < 0 ? "right" : "left", x: left, y: low + 4 - 8 * Math.sign(BESIDE_MM[f]) * Math.sign(cy)};
  }

  // from top to bottom; one that would cover another moves below it
  function labels(texts) {
    c.font = "600 12px system-ui, sans-serif";
    texts.sort((a, b) => a.y - b.y).forEach((label, k) => {
      texts.slice(0, k).forEach((upper) => {
        if (Math.abs(label.x - upper.x) < LABEL_PX[0] && label.y - upper.y < LABEL_PX[1]) label.y = upper.y + LABEL_PX[1];
      });
      c.textAlign = label.align;
      c.fillStyle = label.ink;
      c.fillText(label.text, label.x, label.y);
    });
  }

  return {
    finish, force, labels,
    table: (z) => {
      for (let mm = -TABLE_MM; mm <= TABLE_MM; mm += 20) {
        const style = Math.abs(mm) === TABLE_MM ? colours.soft : colours.grid;
        line([mm, -TABLE_MM, z], [mm, TABLE_MM, z], style);
        line([-TABLE_MM, mm, z], [TABLE_MM, mm, z], style);
      }
    },
    block: (p, name) => {
      const corners = [[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
      corners.forEach((four) => face(four.map((k) => p[k]), name));
    },
    // a body of circular cross-sections: [height, radius] from bottom to top
    turned: (rings, place, name) => {
      const placed = rings.map(([z, r]) => ringAt(z, r).map(place));
      placed.slice(1).forEach((upper, k) => upper.forEach((p, n) => {
        const next = (n + 1) % upper.length;
        face([placed[k][n], placed[k][next], upper[next], p], name);
      }));
      face(placed[placed.length - 1], name);
    },
    // in front of the body's faces that it touches
    ring: (points, name) => points.forEach((p, n) => {
      const ends = [p, points[(n + 1) % points.length]].map(seen);
      faces.push({points: ends, depth: (ends[0][1] + ends[1][1]) / 2 - 1, ring: name});
    }),
  };
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
    const touched = series.true.some((finger) => finger[i] > TOUCH_N);
    const slipping = touched && Math.abs(speed) > SLIPPING_MPS;
    set(surface, {opacity: touched ? 1 : 0.3, transform: `translate(0 ${tall / 2 + mm * zoom})`, class: slipping ? "surface slipping" : "surface"});
    label.textContent = !touched ? "no contact" : slipping ? `${(speed * MM).toFixed(0)} mm/s` : "";
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
