// The server is gone: nothing that is done here has an answer any more. Given: remedy.
const main = document.querySelector("main")
if (!main.querySelector(".ended")) {
  const own = document.createElement("p")
  own.className = "ended"
  own.setAttribute("role", "alert")
  own.textContent = `The studio has ended; ${remedy}.`
  main.prepend(own)
}
