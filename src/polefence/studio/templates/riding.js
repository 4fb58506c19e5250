// The car on its road, frame by frame.
// Given: law, passive, road, words and drawn (data sources), play (toggle), at (slider), what
// ("play", "draw"), and sizes: larger, ahead, spacing, body, radius.
// What is drawn is changed in place: nothing of it travels to the server.

function put(source, columns) {
  Object.assign(source.data, columns)
  source.change.emit()
}

function outline(sprung, unsprung) {
  const x = [-0.7, 0.7, 0.7, -0.7, -0.7, NaN]
  const y = [-0.18, -0.18, 0.18, 0.18, -0.18, NaN].map((own) => own + body + sprung)
  for (let k = 0; k <= 24; k++) {
    x.push(radius * Math.cos(k * Math.PI / 12))
    y.push(radius + unsprung + radius * Math.sin(k * Math.PI / 12))
  }
  return {x, y}
}

function spring(from, to) {
  const x = [0], y = [from]
  for (let k = 1; k < 10; k++) {
    x.push(k % 2 ? 0.12 : -0.12)
    y.push(from + (to - from) * k / 10)
  }
  return {x: [...x, 0], y: [...y, to]}
}

function draw(k) {
  const time = passive.data.time
  if (!(k < time.length)) return
  const place = passive.data.place[k]
  const first = Math.round(place / spacing), count = Math.round(2 * ahead / spacing)
  const height = road.data.height.slice(first, first + count + 1)
  let level = 0
  for (const own of height) level += own / height.length
  const up = (own) => larger * (own - level)
  const x = Array.from(height, (_, i) => i * spacing - ahead)
  put(drawn.ground, {x, y: Array.from(height, up)})
  put(drawn.passive, outline(up(passive.data.sprung[k]), up(passive.data.unsprung[k])))
  const own = law.data
  if (own.time.length != time.length) {
    for (const name of ["law", "spring", "force", "lift", "cursor"]) {
      put(drawn[name], Object.fromEntries(Object.keys(drawn[name].data).map((key) => [key, []])))
    }
    put(words, {x: [-1.95], y: [1.95], text: ["no law"]})
    return
  }
  put(drawn.law, outline(up(own.sprung[k]), up(own.unsprung[k])))
  const bottom = body - 0.18 + up(own.sprung[k])
  put(drawn.spring, spring(radius + up(own.unsprung[k]), bottom))
  put(drawn.force, {x: [0.45, 0.45], y: [bottom, bottom - own.force[k] / 3000]})
  put(drawn.lift, own.lifted[k] ? {x: [0], y: [-0.35]} : {x: [], y: []})
  const said = `${time[k].toFixed(2)} s   force ${own.force[k].toFixed(0)} N`
  put(words, {x: [-1.95], y: [1.95], text: [own.lifted[k] ? `${said}   the tyre leaves the road` : said]})
  put(drawn.cursor, {
    x: [time[k]], acceleration: [own.acceleration[k]], travel: [own.travel[k]], tyre: [own.tyre[k]],
  })
}

const frame = (seconds) =>
  Math.round(Math.min(seconds / at.end, 1) * (passive.data.time.length - 1))
if (what == "play") {
  play.label = play.active ? "Pause" : "Play"
  const begun = performance.now() - 1000 * at.value
  const next = () => {
    if (!play.active) return
    draw(frame(((performance.now() - begun) / 1000) % at.end))
    play.frames = (play.frames || 0) + 1
    requestAnimationFrame(next)
  }
  next()
} else if (!play.active) {
  draw(frame(at.value))
}
