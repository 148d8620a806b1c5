"""Skeleton and style of the page: light and dark, desk, phone and paper."""

PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<main>
<h1>{title}</h1>
<p class="verdict"><strong>{kind}</strong> {headline}</p>
{told}
{causes}
{advice}
{plots}
<h2>Data</h2>
{data}
<p>All numbers of this page are in the file study.json beside it and, as JSON, in the element with the id “study” in it.</p>
</main>
<script type="application/json" id="study">{numbers}</script>
</body>
</html>
"""

STYLE = """
:root {
  --paper: #ffffff; --card: #f7f7f5; --ink: #1a1a1a; --faint: #77777a; --grid: #dedede; --before: #b8470b; --after: #1b5fae;
  --measured: #1a1a1a; --limit: #9b1b6e; --floor: #3f7d20; --cell: #1b5fae; --on-cell: #ffffff;
}
@media screen and (prefers-color-scheme: dark) {
  :root {
    --paper: #16181c; --card: #1f2228; --ink: #ececec; --faint: #8f949c; --grid: #3a3f47; --before: #ff9d5c; --after: #7db8ff;
    --measured: #ececec; --limit: #ff8fd0; --floor: #9ad66f; --cell: #7db8ff; --on-cell: #10141a;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.5 system-ui, "DejaVu Sans", Verdana, sans-serif; }
main { max-width: 76rem; margin: 0 auto; padding: 1rem clamp(0.75rem, 3vw, 2rem) 3rem; overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; line-height: 1.2; margin: 0.5rem 0; }
h2 { font-size: 1.25rem; margin: 1.8rem 0 0.4rem; }
h3 { font-size: 1.05rem; margin: 0 0 0.3rem; }
h4 { font-size: 0.9rem; line-height: 1.3; margin: 0 0 0.2rem; }
h4 small { font-weight: normal; color: var(--faint); }
main > p, main > ul { max-width: 48rem; margin: 0.5rem 0; }
.verdict { font-size: 1.15rem; border-left: 0.3rem solid var(--after); padding: 0.2rem 0 0.2rem 0.8rem; }
.verdict strong { text-transform: uppercase; font-size: 0.85rem; letter-spacing: 0.04em; margin-right: 0.4rem; }
.columns { columns: 2 29rem; column-gap: 1rem; margin-bottom: 1rem; }
.plot { margin: 0 0 1rem; break-inside: avoid; padding: 0.8rem; background: var(--card); border-radius: 0.4rem; min-width: 0; }
.panels { display: grid; gap: 0.8rem; grid-template-columns: minmax(0, 34rem); justify-content: center; }
.wide .panels { grid-template-columns: repeat(auto-fit, minmax(min(100%, 19rem), 1fr)); justify-content: start; }
.wide .panel { max-width: 30rem; }
.panel { display: flex; flex-direction: column; justify-content: end; min-width: 0; }
.panel svg { display: block; width: 100%; height: auto; stroke-linejoin: round; }
.halo text { paint-order: stroke; stroke: var(--card); stroke-width: 4px; }
.plot ol { columns: 2 16rem; column-gap: 1.5rem; font-size: 0.85rem; margin: 0.4rem 0; padding-left: 2rem; }
.plot p { font-size: 0.9rem; margin: 0.3rem 0; }
figcaption { font-size: 0.9rem; margin-top: 0.4rem; max-width: 60rem; }
.legend { list-style: none; display: flex; flex-wrap: wrap; gap: 0.1rem 1.2rem; padding: 0; margin: 0 0 0.4rem; }
.legend li { font-size: 0.85rem; }
.key { display: inline-block; width: 1.8rem; height: 0; margin-right: 0.4rem; vertical-align: middle; border-top: 3px solid; }
.key.before { border-top: 3px dashed var(--before); }
.key.after { border-top-color: var(--after); }
.key.measured { border-top: 6px solid var(--measured); opacity: 0.45; }
.key.limit { border-top: 2px dashed var(--limit); }
.key.floor { border-top: 2px dotted var(--floor); }
.key.dot-after, .key.dot-faint { width: 0.7rem; height: 0.7rem; border: 0; border-radius: 50%; background: var(--after); }
.key.dot-faint { background: var(--faint); }
.key.bar-before, .key.bar-after, .key.shade, .key.band, .key.cell { height: 0.7rem; border: 0; background: var(--after); }
.key.bar-before { background: var(--before); }
.key.shade { opacity: 0.25; }
.key.band { background: var(--faint); opacity: 0.3; }
.key.cell { background: linear-gradient(90deg, transparent, var(--cell)); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.9rem; margin: 0.6rem 0; }
th, td { text-align: left; padding: 0.2rem 0.8rem 0.2rem 0; border-bottom: 1px solid var(--grid); }
th, td { vertical-align: top; overflow-wrap: normal; min-width: 5.5rem; }
summary { cursor: pointer; }
@media print {
  body { font-size: 10pt; }
  main { max-width: none; padding: 0; }
  .columns { columns: 2; }
  .wide .panels { grid-template-columns: 1fr 1fr 1fr; }
  .plot.wide { break-inside: auto; }
  .panel, tr { break-inside: avoid; }
  .plot { background: none; border: 1px solid var(--grid); }
}
"""
