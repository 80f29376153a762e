//! A table whose columns can be sorted where scripts run.

use maud::{Markup, Render, html};

/// One cell of a table.
pub enum Td {
    /// Sorted as a text.
    Text(String),
    /// The text that is shown, and the number that it is sorted by; `None` sorts first.
    Number(String, Option<f64>),
}

impl Td {
    /// With `digits` behind the point, `-` without a value.
    pub fn number(value: Option<f64>, digits: usize) -> Self {
        Self::Number(value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}")), value)
    }

    /// A setting, with as many digits as it has.
    pub fn setting(value: f64) -> Self {
        Self::Number(value.to_string(), Some(value))
    }

    /// A fraction as percent with one digit.
    pub fn percent(fraction: Option<f64>) -> Self {
        Self::number(fraction.map(|fraction| 100.0 * fraction), 1)
    }
}

impl Render for Td {
    fn render(&self) -> Markup {
        match self {
            Self::Text(text) => html! { td { (text) } },
            Self::Number(text, Some(value)) => html! { td.n data-v=(value) { (text) } },
            Self::Number(text, None) => html! { td.n data-v="-1e99" { (text) } },
        }
    }
}

/// The table with its head.
pub fn table(head: &[impl Render], rows: &[Vec<Td>]) -> Markup {
    html! {
        div.wide {
            table.sort {
                thead { tr { @for name in head { th scope="col" { (name) } } } }
                tbody { @for row in rows { tr { @for cell in row { (cell) } } } }
            }
        }
    }
}
