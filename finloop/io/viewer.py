"""A page that shows a .glb and plays its animation, all in one file: it needs no network.

The viewer is <model-viewer> (Apache-2.0), from the installed package `dash-model-viewer`, which is
used for nothing else and never imported.
"""

import base64
import html
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes

_PACKAGE, _SCRIPT = "dash-model-viewer", "dash_model_viewer/vendor/model-viewer-umd.min.js"
_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval';
 style-src 'unsafe-inline'; img-src data: blob:; connect-src data: blob:">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>
 :root {{ color-scheme: dark; }}
 html, body {{ height: 100%; margin: 0; }}
 body {{ display: flex; flex-direction: column; background: #0b222b; color: #e8f4f7;
  font: 16px/1.5 system-ui, sans-serif; }}
 header, footer {{ padding: .5rem 1rem; }}
 h1 {{ font-size: 1.1rem; margin: 0; }}
 p {{ margin: 0; color: #b9d3da; font-size: .9rem; }}
 main {{ flex: 1; min-height: 0; }}
 model-viewer {{ width: 100%; height: 100%; --progress-bar-color: #7fd3e6;
  background: radial-gradient(ellipse at 50% 35%, #4f7f8d, #12303b 75%); }}
 footer {{ display: flex; flex-wrap: wrap; gap: .5rem; }}
 button {{ font: inherit; color: inherit; background: #1c4452; border: 1px solid #7fb4c3;
  border-radius: .4rem; padding: .35rem .9rem; cursor: pointer; }}
 button[aria-pressed="true"] {{ background: #bfe6f0; color: #0b222b; }}
 button:focus-visible, model-viewer:focus-visible {{ outline: 3px solid #ffd479;
  outline-offset: 2px; }}
</style>
</head>
<body>
<header><h1>{title}</h1>
<p>Drag to turn, scroll or pinch to zoom; keyboard: the arrows, and the buttons below.</p>
</header>
<main><model-viewer id="tank" alt="{alt}" camera-controls animation-name="swim" touch-action="none"
 interaction-prompt="none" shadow-intensity="0" exposure="0.5" min-camera-orbit="auto auto 3%"
 field-of-view="30deg">
</model-viewer></main>
<footer>
<button id="play">Play</button>
<button id="corner" data-orbit="-32deg 66deg" data-near="70%">From a corner</button>
<button data-orbit="0deg 1deg" data-near="75%">From above</button>
<button data-orbit="0deg 86deg" data-near="60%">From the side</button>
<button id="follow" aria-pressed="false">Follow the fish</button>
</footer>
<script>{script}</script>
<script>
 const tank = document.getElementById("tank"), play = document.getElementById("play");
 const follow = document.getElementById("follow");
 const scene = Uint8Array.from(atob("{glb}"), (one) => one.charCodeAt(0));
 tank.src = URL.createObjectURL(new Blob([scene], {{ type: "model/gltf-binary" }}));
 play.onclick = () => {{
  if (tank.paused) tank.play(); else tank.pause();
  play.textContent = tank.paused ? "Play" : "Pause";
 }};
 const way = {way};
 let following = false;
 const stop = () => {{ following = false; follow.setAttribute("aria-pressed", "false"); }};
 for (const one of document.querySelectorAll("button[data-orbit]"))
  one.onclick = () => {{
   stop();
   const wide = tank.clientWidth > 1.4 * tank.clientHeight;
   tank.cameraTarget = "auto auto auto";
   tank.cameraOrbit = `${{one.dataset.orbit}} ${{wide ? one.dataset.near : "105%"}}`;
  }};
 document.getElementById("corner").click();
 follow.onclick = () => {{
  if (following) {{ document.getElementById("corner").click(); return; }}
  following = true;
  follow.setAttribute("aria-pressed", "true");
  tank.cameraOrbit = "-32deg 72deg 4.5m";
 }};
 const step = () => {{
  if (following) {{
   const at = way[Math.min(way.length - 1, Math.floor(tank.currentTime * {rate}))];
   tank.cameraTarget = `${{at[0]}}m ${{at[1]}}m ${{at[2]}}m`;
  }}
  requestAnimationFrame(step);
 }};
 step();
 const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
 tank.addEventListener("load", () => {{ if (!still) play.click(); }}, {{ once: true }});
</script>
</body>
</html>
"""


def save_viewer(
    path: Path, glb: bytes, title: str, alt: str, way: list[list[float]], rate_hz: float
) -> None:
    """Write an HTML page that shows a 3-D scene (.glb), with a camera that can follow the fish.

    glb: the file's bytes. alt: a description of the scene for screen readers. way: the fish's place
    x, y, z at every tick, in units of the .glb. rate_hz: ticks per second. FinloopError if the
    viewer is not installed.
    """
    page = _PAGE.format(
        title=html.escape(title),
        alt=html.escape(alt),
        glb=base64.b64encode(glb).decode(),
        script=_script().replace("</script", "<\\/script"),
        way=str([[round(part, 2) for part in place] for place in way]),
        rate=rate_hz,
    )
    save_bytes(path, page.encode())


def _script() -> str:
    try:
        return Path(str(distribution(_PACKAGE).locate_file(_SCRIPT))).read_text(encoding="utf-8")
    except (PackageNotFoundError, OSError) as error:
        raise FinloopError(
            f"the viewer for the 3-D page is not there ({error})",
            f"the package {_PACKAGE}, whose file {_SCRIPT} goes into the page",
            "make setup; or: pip install --no-deps dash-model-viewer==1.0.0",
        ) from error
