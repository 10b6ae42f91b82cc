//! A page of HTML in one file that needs nothing else.

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:1000px;margin:2em auto;\
padding:0 1em;color:#191919;background:#fff}\
pre{font:13px/1.45 ui-monospace,'DejaVu Sans Mono',monospace;overflow-x:auto;background:#f7f7f5;\
padding:1em;border-radius:6px}\
table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:0 0 1.5em}\
td,th{padding:.15em 1.2em .15em 0;text-align:left;vertical-align:top}\
th{border-bottom:1px solid #999;font-weight:600}tr:hover td{background:#f7f7f5}\
.summary{font-size:18px}summary{cursor:pointer;color:#555}\
svg{max-width:100%;height:auto}figure{margin:1.5em 0}\
figcaption{color:#555;font-size:14px}.warning{border-left:4px solid #d55e00;padding-left:1em}";

/// A page that needs nothing else, with its title above its body.
pub(crate) fn html(title: &str, body: &str) -> String {
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{title} - vibroimpact</title>\n<style>{STYLE}</style>\n</head>\n<body>\n\
         <h1>{title}</h1>\n{body}</body>\n</html>\n"
    )
}

/// Text that HTML takes as text.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
