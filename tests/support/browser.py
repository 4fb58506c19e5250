"""A browser without a window, and the studio as a process that it looks at."""

import json
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

from support.needed import require

TOOLS = ("chromium", "chromedriver")
SWITCHES = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
PATIENCE = 60  # [s], of a machine that does much else


def require_browser():
    """Skip where there is no browser; fail where one is promised."""
    require(tool for tool in TOOLS if shutil.which(tool) is None)


@contextmanager
def browser(width=1280, height=900, dark=False):
    """Open one."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for switch in SWITCHES:
        options.add_argument(switch)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    own = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    own.set_script_timeout(PATIENCE)
    resized(own, width, height, dark)
    try:
        yield own
    finally:
        own.quit()


def resized(own, width=1280, height=900, dark=False):
    """Have a browser be of another size, and its user like another scheme."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
    own.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    own.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": scheme})


@contextmanager
def studio(folder, *words, port=0):
    """Run ``polefence studio`` in a folder; yield its address and process."""
    command = [sys.executable, "-m", "polefence", "studio", *words, "--no-browser"]
    command += ["--port", str(port)]
    own = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        line = own.stdout.readline()
        assert line.startswith("studio: http://127.0.0.1:"), line + own.stdout.read()
        yield line.removeprefix("studio: ").strip(), own
    finally:
        own.kill()
        own.communicate()


def until(ask, *, patience=PATIENCE):
    """Ask again and again until the answer is true; return it."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        with suppress(Exception):  # the page may be in the middle of a change
            if found := ask():
                return found
        time.sleep(0.1)
    return ask()


def text_of(page):
    """All that a page says, in shadow roots too."""
    return page.execute_script(
        """
        const said = []
        const walk = (node) => {
          if (node.nodeType == 3) said.push(node.data)
          if (node.shadowRoot) walk(node.shadowRoot)
          if (!["STYLE", "SCRIPT"].includes(node.nodeName)) node.childNodes.forEach(walk)
        }
        walk(document.body)
        return said.join(" ")
        """
    )


def element(page, script, *given):
    """The element that a script finds among ``all``, every element of the page."""
    return page.execute_script(
        """
        const all = []
        const walk = (node) => {
          all.push(node)
          if (node.shadowRoot) [...node.shadowRoot.children].forEach(walk)
          ;[...node.children].forEach(walk)
        }
        walk(document.body)
        """
        + script,
        *given,
    )


def named(page, name):
    """The input or button that is labelled so, in sight: columns scroll by themselves."""
    found = element(
        page,
        """
        const [name] = arguments
        const button = all.find(e => e.nodeName == "BUTTON" && e.textContent.trim() == name)
        if (button) return button
        const says = (e) => e.nextSibling ? e.nextSibling.textContent.trim() : ""
        const box = all.find(e => e.type == "checkbox" && says(e).startsWith(name))
        if (box) return box
        const label = all.find(e => e.nodeName == "LABEL" && e.textContent.trim().startsWith(name))
        return label && label.getRootNode().querySelector("input, select, [role=slider]")
        """,
        name,
    )
    if found is not None:
        page.execute_script('arguments[0].scrollIntoView({block: "center"})', found)
    return found


def complaints(page):
    """What the console says of errors."""
    return [own["message"] for own in page.get_log("browser") if own["level"] == "SEVERE"]


def requests(page):
    """All addresses that were asked for, WebSockets among them."""
    found = []
    for entry in page.get_log("performance"):
        message = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            found.append(message["params"]["request"]["url"])
        elif message["method"] == "Network.webSocketCreated":
            found.append(message["params"]["url"])
    return found
