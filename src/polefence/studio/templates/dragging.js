// Dragging of handles: what is asked of the server, one place at a time.
// Given: asked, seen, handles (data sources), plot, reach [pixels], what ("begin", "move", "end", "seen").

// The handle that is nearest to where a drag begins, -1 if none is near.
function nearest(event) {
  const {x, y} = handles.data
  let found = -1, best = reach
  for (let i = 0; i < x.length; i++) {
    const dx = (x[i] - event.x) / (plot.x_range.end - plot.x_range.start) * plot.inner_width
    const dy = (y[i] - event.y) / (plot.y_range.end - plot.y_range.start) * plot.inner_height
    const away = Math.hypot(dx, dy)
    if (away < best) { best = away; found = i }
  }
  return found
}

// Of the places that come while the server is at work, the last is asked for next.
function send() {
  if (asked.waiting || !asked.next) return
  const place = asked.next
  asked.next = null
  asked.count = asked.waiting = (asked.count || 0) + 1
  asked.sent = {...asked.sent, [asked.count]: performance.now()}
  asked.data = {...place, number: [asked.count], begin: [asked.fresh]}
  asked.fresh = false
}

if (what == "begin") {
  asked.held = nearest(cb_obj)
  asked.fresh = true
} else if (what == "seen") {
  const now = performance.now()
  const {number: [number], shown: [shown]} = seen.data
  for (const [k, since] of Object.entries(asked.sent || {})) {
    if (k == shown) asked.times = [...(asked.times || []).slice(-999), now - since]
    if (k <= shown) delete asked.sent[k]
  }
  if (asked.waiting <= number) asked.waiting = 0
  send()
} else if (asked.held >= 0) {
  asked.next = {x: [cb_obj.x], y: [cb_obj.y], handle: [asked.held], end: [what == "end"]}
  if (what == "end") asked.held = -1
  send()
}
