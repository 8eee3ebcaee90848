"""The style sheet and the one script of the report: inline, because the page must open without a
network.
"""

CSS = """\
:root{color-scheme:light dark;--back:#f5f6f8;--card:#fff;--text:#1b1d22;--muted:#646975;
 --line:#e4e6ea;
--accent:#2563a8;--good:#0f7a4a;--fair:#9a5a00;--bad:#b3261e}
@media(prefers-color-scheme:dark){:root{--back:#0f1013;--card:#17191e;--text:#eceef2;
 --muted:#9aa0ac;
--line:#2c3038;--accent:#6fb1f5;--good:#5cc98f;--fair:#f0b35e;--bad:#ff8a80}}
*{box-sizing:border-box}
body{margin:0;background:var(--back);color:var(--text);
font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",sans-serif}
main{max-width:1120px;margin:0 auto;padding:40px 24px 72px}
h1{font-size:30px;line-height:1.2;letter-spacing:-.02em;margin:0 0 14px;overflow-wrap:anywhere}
h2{font-size:20px;letter-spacing:-.01em;margin:52px 0 14px}
h3{font-size:15px;margin:0 0 8px}
.eyebrow{color:var(--muted);font-size:14px;margin:0 0 6px}
.advice{font-size:18px;max-width:70ch;margin:0}
.badge{display:inline-block;padding:2px 11px;border-radius:99px;border:1.5px solid;font-size:14px;
 font-weight:600;
margin-right:10px;white-space:nowrap}
.converged{color:var(--good)}.budget_spent{color:var(--fair)}.stopped{color:var(--bad)}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:12px;
 margin:26px 0 0;padding:0}
.tiles div{display:flex;flex-direction:column;justify-content:space-between;
background:var(--card);border:1px solid var(--line);border-radius:10px;padding:12px 14px}
.tiles dt{color:var(--muted);font-size:13px;line-height:1.35}
.tiles dd{white-space:nowrap;margin:2px 0 0;font-size:24px;font-weight:600;letter-spacing:-.02em;
font-variant-numeric:tabular-nums}
.tiles dd span{font-size:14px;font-weight:400;color:var(--muted);letter-spacing:0}
figure{margin:0 0 18px;background:var(--card);border:1px solid var(--line);border-radius:12px;
 overflow:hidden}
figure.dark{background:#17191e}
figure img{display:block;width:100%;height:auto}
figcaption{padding:10px 16px;color:var(--muted);font-size:14px;background:var(--card);
 border-top:1px solid var(--line)}
.columns{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,320px),1fr));gap:18px;
 align-items:start}
.columns figure{margin:0}
.chart{padding:8px}
@media(prefers-color-scheme:dark){.chart img{filter:invert(1) hue-rotate(180deg);
 mix-blend-mode:screen}}
.wide{overflow-x:auto}.wide img{min-width:680px}
.compare{position:relative;--at:50%;margin:auto;background:#17191e}
.compare img{display:block;width:100%;height:auto}
.compare .over{position:absolute;inset:0;clip-path:inset(0 0 0 var(--at))}
.compare i{position:absolute;top:0;bottom:0;left:var(--at);width:2px;margin-left:-1px;
 background:#fff;
box-shadow:0 0 6px #0009;pointer-events:none}
.compare i:after{content:"\\2039\\2002\\203a";color:#333;font:600 18px/28px system-ui;
 text-align:center;
position:absolute;top:50%;left:50%;width:30px;height:30px;transform:translate(-50%,-50%);
border-radius:50%;background:#fff;box-shadow:0 1px 5px #0008}
.compare b{position:absolute;bottom:10px;padding:1px 9px;border-radius:6px;background:#000a;
 color:#fff;font-size:13px;
font-weight:600;pointer-events:none}
.compare b.photo{left:10px}.compare b.fit{right:10px}
.compare input{position:absolute;inset:0;width:100%;height:100%;margin:0;opacity:0;cursor:ew-resize}
.compare input:focus-visible~i{outline:3px solid var(--accent);outline-offset:2px}
.card{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:16px 18px;
margin:0 0 18px;overflow-x:auto}
.columns .card{margin:0}
table{border-collapse:collapse;width:100%;font-size:14.5px;font-variant-numeric:tabular-nums}
th{color:var(--muted);font-weight:500;text-align:left;font-size:13px}
td,th{padding:6px 14px 6px 0;border-bottom:1px solid var(--line);vertical-align:top}
td:last-child,th:last-child{padding-right:0}
tr:last-child td{border-bottom:0}
.n{text-align:right;white-space:nowrap}
.place{white-space:nowrap}
.unit{color:var(--muted)}
.bar{width:26%;min-width:56px}
.bar span{display:block;height:8px;margin-top:8px;border-radius:3px;background:var(--accent);
 min-width:1px}
.swatch{display:inline-block;width:14px;height:14px;border-radius:4px;border:1px solid var(--line);
 vertical-align:-2px}
.off td{color:var(--muted)}
details{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:12px 18px;
 overflow-x:auto}
summary{cursor:pointer;font-weight:600;font-size:15px}
details[open] summary{margin-bottom:10px}
code{font:14px/1.5 ui-monospace,SFMono-Regular,Menlo,Consolas,monospace}
pre{margin:8px 0 0;padding:12px 14px;background:var(--back);border:1px solid var(--line);
border-radius:8px;overflow-x:auto}
p.note{color:var(--muted);font-size:14px;margin:0 0 10px}
@media(max-width:560px){main{padding:24px 14px 48px}h1{font-size:24px}h2{margin-top:38px}
 .advice{font-size:16px}}
@media print{main{max-width:none}.compare input{display:none}figure,.card{break-inside:avoid}}
"""

COMPARE_INPUT = (
    '<input type="range" min="0" max="100" value="50" step="0.5" aria-label="Move between the '
    'photo and the fit" '
    "oninput=\"this.parentNode.style.setProperty('--at',this.value+'%')\">"
)
