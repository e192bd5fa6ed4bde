"""The looks of the report: light and dark, screen and paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from mnsf_ros.drawing.figures import DARK, LIGHT


def _variables(colors: Mapping[str, str]) -> str:
    return "".join(f"--{name}:{color};" for name, color in colors.items())


STYLE: Final = (
    ":root{color-scheme:light dark;--page:#f6f7f9;"
    "--good:#0d6b3c;--goodback:#e2f4ea;--accent:#0b62c4;"
    f"{_variables(LIGHT)}}}"
    "@media (prefers-color-scheme:dark){:root{--page:#101216;"
    "--good:#7ce0ab;--goodback:#17352a;--accent:#6cb0ff;"
    f"{_variables(DARK)}}}}}"
    """
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--ink);
font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif}
main,header>div,footer{max-width:1120px;margin:0 auto;padding:0 24px}
header{background:var(--card);border-bottom:1px solid var(--line);padding:34px 0 26px}
h1{font-size:30px;line-height:1.2;margin:0 0 6px;letter-spacing:-.01em}
h2{font-size:21px;margin:44px 0 6px;letter-spacing:-.005em}
h3{font-size:16px;margin:0 0 4px}
h1,h2,h3,p,li,figcaption,caption{overflow-wrap:anywhere}
p{margin:6px 0;max-width:78ch}
.faint,figcaption,caption{color:var(--faint);font-size:14px}
a{color:var(--accent)}
nav{margin-top:14px;font-size:14px}
nav a{margin-right:18px;text-decoration:none}
nav a:hover{text-decoration:underline}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:12px;
margin:20px 0 0}
.tile{border:1px solid var(--line);border-radius:10px;padding:12px 16px;background:var(--page)}
.tile b{display:block;font-size:26px;line-height:1.25;font-variant-numeric:tabular-nums}
.tile span{color:var(--faint);font-size:13px;display:block}
.card{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:18px 20px;
margin:16px 0}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:14.5px;font-variant-numeric:tabular-nums}
caption{text-align:left;padding:0 0 8px;caption-side:top}
caption b{color:var(--ink);font-size:16px}
th,td{padding:6px 12px;text-align:right;border-bottom:1px solid var(--line);white-space:nowrap}
thead th{color:var(--faint);font-weight:600;font-size:13px;border-bottom-width:2px}
th:first-child,td:first-child{text-align:left;padding-left:4px}
tbody th{font-weight:600}
tbody tr:last-child>*{border-bottom:0}
td.best{color:var(--good);background:var(--goodback);font-weight:700}
.words th,.words td{text-align:left;white-space:normal;overflow-wrap:anywhere}
.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(440px,100%),1fr));gap:16px}
.pair .card{margin:0}
.pair{margin:16px 0}
figure{margin:0}
figure svg{display:block;width:100%;height:auto}
.wide svg{min-width:680px}
.picture{margin:12px 0 4px}
.picture img{display:block;width:100%;height:auto;border-radius:8px}
.truth{max-width:65%}
.picture figcaption{margin:6px 0 0}
details{margin:14px 0}
summary{cursor:pointer;font-weight:600;padding:4px 0}
dl{display:grid;grid-template-columns:max-content 1fr;gap:4px 20px;margin:0;font-size:14.5px}
dt{color:var(--faint)}
dd{margin:0;overflow-wrap:anywhere}
code{font:13px/1.5 ui-monospace,SFMono-Regular,Menlo,Consolas,monospace}
ul.notes{margin:6px 0;padding-left:20px}
footer{padding:30px 24px 50px;color:var(--faint);font-size:13px}
@media (max-width:560px){dl{grid-template-columns:1fr}dd{margin-bottom:8px}
h1{font-size:25px}.truth{max-width:none}
main,header>div,footer{padding-left:16px;padding-right:16px}}
@media print{:root{color-scheme:light;--page:#fff;
--good:#064d29;--goodback:#e2f4ea;"""
    f"{_variables(LIGHT)}"
    """}
body{font-size:12px}nav{display:none}.scroll{overflow:visible}
.card,figure,tr{break-inside:avoid}.card.long{break-inside:auto}h2,h3{break-after:avoid}
.tiles{grid-template-columns:repeat(5,1fr)}
th,td{padding:3px 6px;font-size:10px}
details::details-content{content-visibility:visible;display:block;height:auto}
*{-webkit-print-color-adjust:exact;print-color-adjust:exact}}
"""
)
