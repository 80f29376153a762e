//! Scalars of YAML as ROS 2 parameters need them: read with their quotes, and strings written so that they read back.

use crate::yaml::{Content, Item, read};

/// Returns the text of a scalar; that of a quoted one is quoted again, so that it stays a string.
pub fn scalar(item: &Item) -> Option<String> {
    match &item.content {
        Content::Scalar(text, _) if item.plain => Some(text.clone()),
        Content::Scalar(text, _) => Some(quoted(text)),
        _ => None,
    }
}

/// Returns the string that `text` stands for: itself, unless it is quoted.
pub fn string(text: &str) -> Option<String> {
    if !text.starts_with(['"', '\'']) {
        return Some(text.to_owned());
    }
    match read(text).ok()?.content {
        Content::Scalar(inner, _) => Some(inner),
        _ => None,
    }
}

/// Returns the scalars of a list `[a, 'b']`, or of `a, b`, with their quotes.
pub fn items(text: &str) -> Option<Vec<String>> {
    if !text.starts_with('[') {
        let items = text.split(',').map(str::trim).filter(|item| !item.is_empty());
        return Some(items.map(str::to_owned).collect());
    }
    match read(text).ok()?.content {
        Content::List(items) => items.iter().map(scalar).collect(),
        _ => None,
    }
}

/// Returns a string as a YAML scalar: plain where no reader takes it for anything else.
pub fn of_string(text: &str) -> String {
    let word = |c: char| c.is_ascii_alphanumeric() || "_/.+-?&=".contains(c);
    // A word that starts with a letter is no number, and a colon is safe only inside of `://`.
    let plain = text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '/' || c == '_')
        && text.replace("://", "").chars().all(word);
    // YAML 1.1 takes these for booleans or null.
    let reserved = ["null", "true", "false", "yes", "no", "on", "off", "y", "n"];
    if plain && !reserved.contains(&text.to_ascii_lowercase().as_str()) {
        return text.to_owned();
    }
    quoted(text)
}

/// Returns a string as a quoted YAML scalar.
pub fn quoted(text: &str) -> String {
    // Single quotes know no escapes, so control characters need the other form.
    if !text.contains(char::is_control) {
        return format!("'{}'", text.replace('\'', "''"));
    }
    let escaped = text.chars().map(|c| match c {
        '"' | '\\' => format!("\\{c}"),
        c if c.is_control() => format!("\\U{:08x}", u32::from(c)),
        c => c.to_string(),
    });
    format!("\"{}\"", escaped.collect::<String>())
}

/// Returns a double with its decimal point.
pub fn of_double(value: f64) -> String {
    if value.is_nan() {
        return ".nan".to_owned();
    }
    if value.is_infinite() {
        return if value > 0.0 { ".inf" } else { "-.inf" }.to_owned();
    }
    let text = format!("{value:?}");
    // YAML 1.1 wants a decimal point and a sign in the exponent.
    match text.split_once('e') {
        None => text,
        Some((mantissa, exponent)) => {
            let point = if mantissa.contains('.') { "" } else { ".0" };
            let sign = if exponent.starts_with('-') { "" } else { "+" };
            format!("{mantissa}{point}e{sign}{exponent}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strings_are_quoted_only_where_they_must() {
        for (text, written) in [
            ("recovered", "recovered"),
            ("scene://day?seed=1&frames=2", "scene://day?seed=1&frames=2"),
            ("/a/b.onnx", "/a/b.onnx"),
            ("", "''"),
            ("no", "'no'"),
            ("640x480", "'640x480'"),
            ("it's", "'it''s'"),
            ("a: b", "'a: b'"),
            ("a\nb", "\"a\\U0000000ab\""),
        ] {
            assert_eq!(of_string(text), written);
            assert_eq!(string(written).as_deref(), Some(text));
        }
    }

    #[test]
    fn doubles_keep_their_point() {
        for (value, written) in
            [(4.0, "4.0"), (0.25, "0.25"), (1e300, "1.0e+300"), (1.5e-9, "1.5e-9"), (f64::INFINITY, ".inf")]
        {
            assert_eq!(of_double(value), written);
        }
    }
}
