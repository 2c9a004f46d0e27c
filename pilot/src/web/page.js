"use strict";
// The client protocol over a web socket; the token comes in the address's fragment.
const SIDE = 32, LEASE_MS = 3000, LOG_LINES = 200, PATH_POINTS = 20000;
const COLOURS = { "#": [20, 20, 20], ".": [245, 245, 245], " ": [136, 136, 136] };
const byId = (id) => document.getElementById(id);
const canvas = byId("map");
let socket = null, frame = null, cellMm = 25, tiles = new Map(), path = [], dirty = true;
let problem = "", log = [], asked = [], kept = 0;

// Each request gets one reply, in order.
function send(request) {
  if (!socket || socket.readyState !== WebSocket.OPEN) return;
  asked.push(request.do);
  socket.send(JSON.stringify(request));
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.onopen = () => {
    send({ do: "hello", version: 1, name: "page", token: location.hash.slice(1) });
    send({ do: "watch", every: 4 });
  };
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onclose = () => {
    [frame, asked] = [null, []];
    show();
    setTimeout(connect, 2000);
  };
}

function take(message) {
  if (message.type === "frame") {
    frame = message;
    document.body.dataset.timeUs = frame.robot.time_us;
    const here = frame.estimate, last = path[path.length - 1];
    if (here && (!last || Math.hypot(here.x_mm - last[0], here.y_mm - last[1]) > 20)) {
      path.push([here.x_mm, here.y_mm]);
      if (path.length > PATH_POINTS) path.shift();
    }
    show();
    // A hidden page's timers hardly run.
    if (Date.now() - kept > LEASE_MS / 6) keep();
  } else if (message.type === "map") {
    cellMm = message.cell_mm;
    tiles.clear();
    path = [];
  } else if (message.type === "tiles") {
    for (const tile of message.tiles) tiles.set(`${tile.column} ${tile.row}`, draw(tile));
    canvas.dataset.updates = Number(canvas.dataset.updates || 0) + message.tiles.length;
  } else if (message.type === "log") {
    log.push(message.line);
    log = log.slice(-LOG_LINES);
    byId("log").textContent = log.join("\n");
    byId("log").scrollTop = byId("log").scrollHeight;
  } else if (message.type === "done") {
    problem = message.error ? message.error.text : `${message.activity}: done`;
  } else if (message.type === "reply") {
    // Who does not drive keeps its lease in vain.
    if (asked.shift() !== "keep" && message.error) {
      problem = message.error.text;
      show();
    }
  }
  dirty = true;
}

function draw(tile) {
  const image = new OffscreenCanvas(SIDE, SIDE), context = image.getContext("2d");
  const pixels = context.createImageData(SIDE, SIDE);
  for (let index = 0; index < SIDE * SIDE; index++) {
    // The map's y points up, the picture's down.
    const at = 4 * ((SIDE - 1 - Math.floor(index / SIDE)) * SIDE + (index % SIDE));
    pixels.data.set([...(COLOURS[tile.cells[index]] || COLOURS[" "]), 255], at);
  }
  context.putImageData(pixels, 0, 0);
  return { column: tile.column, row: tile.row, image };
}

function show() {
  const robot = frame && frame.robot, number = (value, digits) => value == null ? "–" : value.toFixed(digits);
  byId("connection").textContent = frame ? frame.error || problem || "connected" : "not connected: check the address and its token";
  byId("state").textContent = robot ? [robot.state, frame.activity, ...robot.faults].join(", ") : "";
  byId("driver").textContent = frame ? `${frame.driver || "none"} (${frame.clients} clients)` : "";
  const here = frame && frame.estimate;
  byId("pose").textContent = here ? `${number(here.x_mm, 0)} mm, ${number(here.y_mm, 0)} mm, ${number(here.rotation_deg, 1)}° ± ${number(here.deviation_mm, 0)} mm` : "";
  byId("ranges").textContent = robot ? robot.ranges_mm.map((range) => number(range, 0)).join(", ") + " mm" : "";
  byId("battery").textContent = robot ? robot.cells_v.map((cell) => number(cell, 2)).join(", ") + " V" : "";
  byId("link").textContent = robot ? `${robot.link.frames} frames, ${robot.link.rejected} rejected, worst gap ${number(robot.link.worst_gap_us / 1000, 1)} ms` : "";
  byId("explore").textContent = frame && frame.activity === "explore" ? "End exploring" : "Explore";
  byId("advice").replaceChildren(...(frame ? frame.advice : []).map((text) => {
    const item = document.createElement("li");
    item.textContent = text;
    return item;
  }));
}

/** Scale and offset that show the whole map. */
function view() {
  let [west, east, south, north] = [-500, 500, -500, 500];
  const side = SIDE * cellMm;
  for (const { column, row } of tiles.values()) {
    [west, east] = [Math.min(west, column * side), Math.max(east, (column + 1) * side)];
    [south, north] = [Math.min(south, row * side), Math.max(north, (row + 1) * side)];
  }
  const scale = Math.min(canvas.width / (east - west), canvas.height / (north - south));
  const left = (canvas.width - scale * (east - west)) / 2, top = (canvas.height - scale * (north - south)) / 2;
  return {
    scale,
    x: (mm) => left + (mm - west) * scale, y: (mm) => top + (north - mm) * scale,
    xMm: (px) => (px - left) / scale + west, yMm: (px) => north - (px - top) / scale,
  };
}

function paint() {
  requestAnimationFrame(paint);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height, dirty] = [width, height, true];
  if (!dirty) return;
  dirty = false;
  const context = canvas.getContext("2d"), to = view();
  context.clearRect(0, 0, width, height);
  context.imageSmoothingEnabled = false;
  const side = SIDE * cellMm;
  for (const { column, row, image } of tiles.values()) {
    context.drawImage(image, to.x(column * side), to.y((row + 1) * side), side * to.scale + 1, side * to.scale + 1);
  }
  context.strokeStyle = "#06c";
  context.beginPath();
  for (const [x, y] of path) context.lineTo(to.x(x), to.y(y));
  context.stroke();
  if (frame && frame.estimate) {
    const { x_mm, y_mm, rotation_deg } = frame.estimate;
    context.save();
    context.translate(to.x(x_mm), to.y(y_mm));
    context.rotate(-rotation_deg * Math.PI / 180);
    const size = Math.max(100 * to.scale, 6);
    context.fillStyle = "#c00";
    context.beginPath();
    context.moveTo(size, 0);
    context.lineTo(-size, -size * 0.8);
    context.lineTo(-size, size * 0.8);
    context.fill();
    context.restore();
  }
}

function drive(request) {
  problem = "";
  send({ ...request, lease_ms: LEASE_MS });
}

function keep() {
  kept = Date.now();
  send({ do: "keep" });
}

function stop() {
  send({ do: "stop" });
}

byId("stop").onclick = stop;
byId("clear").onclick = () => send({ do: "clear-faults" });
byId("new-map").onclick = () => send({ do: "new-map" });
byId("explore").onclick = () => frame && frame.activity === "explore" ? stop() : drive({ do: "explore" });
canvas.onclick = (event) => {
  const to = view();
  drive({ do: "goto", x_mm: to.xMm(event.offsetX), y_mm: to.yMm(event.offsetY) });
};
document.onkeydown = (event) => {
  if (event.key === " " || event.key === "Escape") {
    event.preventDefault();
    stop();
  }
};
setInterval(keep, LEASE_MS / 6);
connect();
paint();
