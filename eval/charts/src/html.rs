//! [`html_page`]: the frame of an HTML page that needs no network.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// An HTML page with the style sheet that all pages share, followed by the rules `css` of this page.
pub fn html_page(title: &str, css: &str, body: Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) (PreEscaped(css)) }
            }
            body { (body) }
        }
    }
    .into_string()
}
