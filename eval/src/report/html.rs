//! Pieces of HTML, written so that they are well-formed XML too.

/// The whole document around `body`.
pub fn document(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<title>{title}</title>\n\
         <style>\n{}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{body}<script>\n{}</script>\n</body>\n</html>\n",
        include_str!("style.css"),
        include_str!("sort.js"),
        title = escape(title),
    )
}

/// Text as text.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// One cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Td {
    /// Sorted as a text.
    Text(String),
    /// As it is shown, and what it is sorted by; `None` sorts first.
    Number(String, Option<f64>),
}

impl Td {
    /// A text.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// With `digits` behind the point, `-` without a value.
    pub fn number(value: Option<f64>, digits: usize) -> Self {
        Self::Number(value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}")), value)
    }

    /// A fraction as percent with one digit.
    pub fn percent(fraction: Option<f64>) -> Self {
        Self::number(fraction.map(|fraction| 100.0 * fraction), 1)
    }

    fn html(&self) -> String {
        match self {
            Self::Text(text) => format!("<td>{}</td>", escape(text)),
            Self::Number(text, value) => {
                let value = value.map_or_else(|| "-1e99".to_owned(), |value| value.to_string());
                format!("<td class=\"n\" data-v=\"{value}\">{}</td>", escape(text))
            }
        }
    }
}

/// A table whose columns can be sorted where scripts run.
pub fn table(head: &[String], rows: &[Vec<Td>]) -> String {
    let head: String = head.iter().map(|name| format!("<th scope=\"col\">{}</th>", escape(name))).collect();
    let row = |cells: &Vec<Td>| format!("<tr>{}</tr>\n", cells.iter().map(Td::html).collect::<String>());
    let rows: String = rows.iter().map(row).collect();
    format!(
        "<div class=\"wide\"><table class=\"sort\">\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n\
         </table></div>\n"
    )
}

/// A paragraph.
pub fn p(text: &str) -> String {
    format!("<p>{}</p>\n", escape(text))
}
