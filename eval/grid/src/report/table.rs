//! A table whose columns a script can sort.

use maud::{Markup, Render, html};

/// One cell of a table.
pub enum Td {
    /// A text.
    Text(String),
    /// A displayed text and the number by which it is sorted. `None` sorts first.
    Number(String, Option<f64>),
}

impl Td {
    /// A number with `digits` decimal digits; `-` without a value.
    pub fn number(value: Option<f64>, digits: usize) -> Self {
        Self::Number(value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}")), value)
    }

    /// A setting with all its digits.
    pub fn setting(value: f64) -> Self {
        Self::Number(value.to_string(), Some(value))
    }

    /// A fraction as percent with one decimal digit.
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

/// A table with its head.
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
