"""Write `plots_page.html`, the page that `dvc plots show` and `dvc plots diff` fill, drawn offline.

DVC's own page loads Vega from the web. This one has Vega, Vega-Lite and Vega-Embed inlined (all
BSD-3-Clause) as bundled in the PyPI package vl-convert-python, and leaves out the placeholder
where DVC would put its links. Run again only to change the page or the version::

    pip install vl-convert-python==1.9.0.post1
    python .dvc/plots_page.py

The page is kept in git, so that it is there in a temporary experiment too.
"""

from pathlib import Path

import vl_convert

VEGA_LITE = "5.21"  # DVC's chart specifications are Vega-Lite 5

HEAD = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
{refresh_tag}
<title>finloop: plots</title>
<style>
  body { font-family: sans-serif; margin: 2em; }
  img { max-width: 43vw; }  /* two revisions side by side; one alone takes the page */
  body > div > div:only-of-type > img { max-width: 90vw; }
</style>
<!-- Vega, Vega-Lite, Vega-Embed: (c) University of Washington Interactive Data Lab and
     contributors, BSD-3-Clause; with parts of D3: (c) Mike Bostock, ISC and BSD-3-Clause. -->
<script>
(() => {
"""
TAIL = """
})();
</script>
</head>
<body>
{plot_divs}
</body>
</html>
"""

if __name__ == "__main__":
    bundle = vl_convert.javascript_bundle(vl_version=VEGA_LITE)
    # A closing tag or one of DVC's placeholders amid the code would break the page.
    for trap in ("</script", "{plot_divs}", "{refresh_tag}", "{scripts}"):
        if trap in bundle:
            raise SystemExit(f"the bundle holds {trap!r}, which this page cannot carry")
    page = Path(__file__).with_suffix(".html")
    page.write_text(HEAD + bundle.rstrip() + TAIL, encoding="utf-8")
    print(f"{page}: {page.stat().st_size} bytes")
