//! [`without_secrets`]: text that may be shown although a URL in it has a password.

use std::borrow::Cow;

/// Schemes of the URLs that may hold a password or a token.
const SCHEMES: [&str; 4] = ["rtsp://", "rtsps://", "http://", "https://"];

/// Returns `text` with `***` in place of the user and the password of a camera's URL, and in place of each query behind it, since many
/// cameras take their password there. Everything between the scheme and the last `@` is hidden, as a password may hold any character.
///
/// ```
/// use modulo_runtime::secret::without_secrets;
///
/// let shown = without_secrets("rtsp://admin:1234@10.0.0.3/live?token=5: no answer");
/// assert_eq!(shown, "rtsp://***@10.0.0.3/live?*** no answer");
/// ```
pub fn without_secrets(text: &str) -> Cow<'_, str> {
    let lower = text.to_ascii_lowercase();
    let ends = SCHEMES.iter().filter_map(|scheme| Some(lower.find(scheme)? + scheme.len()));
    let Some(start) = ends.min() else { return Cow::Borrowed(text) };
    let (mut shown, rest) = (text[..start].to_owned(), &text[start..]);
    let rest = match rest.rsplit_once('@') {
        Some((_, rest)) => {
            shown.push_str("***@");
            rest
        }
        None => rest,
    };
    let mut parts = rest.split('?');
    shown.push_str(parts.next().unwrap_or_default());
    for query in parts {
        let end = query.find(|c: char| c.is_whitespace() || "'\"<>".contains(c)).unwrap_or(query.len());
        shown.push_str(if end == 0 { "?" } else { "?***" });
        shown.push_str(&query[end..]);
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_passwords_and_queries_are_hidden() {
        for (text, shown) in [
            ("rtsp://10.0.0.3:554/live", "rtsp://10.0.0.3:554/live"),
            ("RTSP://a:b@cam/1", "RTSP://***@cam/1"),
            ("rtsps://a:p@ss/w rd@cam/1", "rtsps://***@cam/1"),
            ("https://user@cam", "https://***@cam"),
            ("http://a:b?c@cam/1?t=2", "http://***@cam/1?***"),
            ("is 'http://cam/?t=2' there? no", "is 'http://cam/?***' there? no"),
            ("http://a:b@c, http://d:e@f", "http://***@f"),
            ("http://x:http://y@z/", "http://***@z/"),
            ("scene://day?seed=3", "scene://day?seed=3"),
            ("/data/drive.mp4?é@", "/data/drive.mp4?é@"),
            ("https://", "https://"),
        ] {
            assert_eq!(without_secrets(text), shown);
        }
    }
}
