"""The style sheet of the page: dark on white, on a phone as on paper."""

from __future__ import annotations

from typing import Final

CSS: Final = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 62rem; padding: 1rem; background: #fff; color: #1a1a1a;
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif; }
h1 { font-size: 1.5rem; margin: 0 0 .25rem; }
h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; border-bottom: 1px solid #ccc; }
p, li { max-width: 46rem; overflow-wrap: anywhere; }
.verdict { border-left: .6rem solid; padding: .75rem 1rem; background: #f6f6f6; }
.verdict p { margin: .25rem 0; }
.pass { border-color: #00734d; } .pass h1 { color: #00573a; }
.fail { border-color: #b3400a; } .fail h1 { color: #96360a; }
.inconclusive { border-color: #8a6d00; } .inconclusive h1 { color: #6b5500; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; }
th, td { text-align: left; vertical-align: top; padding: .25rem .75rem .25rem 0;
  border-bottom: 1px solid #ddd; }
thead th { border-bottom: 2px solid #888; }
tbody th { font-weight: 400; }
h3 { font-size: 1rem; margin: 1rem 0 .25rem; }
td.number { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; }
figure { margin: 1.5rem 0; }
img { max-width: 100%; height: auto; display: block; }
figcaption { font-size: .9rem; color: #333; max-width: 46rem; }
code { font-size: .9em; overflow-wrap: anywhere; }
footer { margin-top: 2rem; color: #555; font-size: .85rem; }
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  .verdict { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  figure, tr, .verdict { break-inside: avoid; }
  h2 { break-after: avoid; }
  .scroll { overflow: visible; }
}
"""
