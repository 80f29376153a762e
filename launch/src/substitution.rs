//! Texts with substitutions `$(name arguments)`, in the grammar of ROS 2's `launch` frontend. Every string of a launch file
//! can be such a text. Nothing is executed here, and no Python or shell is ever evaluated.
//!
//! A backslash makes the next character plain; a dollar that opens no substitution needs one. Within `$(...)` arguments are
//! separated by one space each, may be quoted with `'` or `"`, and nest. A text that ROS 2 reads otherwise is refused.

mod function;

use function::Function;
pub use function::Surroundings;
pub(crate) use function::truth;

/// No launch file nests substitutions deeper than this; keeps recursion bounded.
const DEEPEST: usize = 32;

/// A piece of a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// Plain text.
    Text(String),
    /// The value of `$(function arguments)`; empty where it is not evaluated.
    Value(String),
}

impl Piece {
    pub(crate) fn as_str(&self) -> &str {
        let (Self::Text(text) | Self::Value(text)) = self;
        text
    }
}

/// Why a text is not valid, or has no value: what is wrong and what is possible.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SubstitutionError(pub(crate) String);

/// Parses `text`, and evaluates its substitutions where they are `around` something.
///
/// # Errors
/// [`SubstitutionError`] for a substitution without an end, an unknown one, a wrong count, or one without a value.
pub fn pieces(text: &str, around: Option<&Surroundings<'_>>) -> Result<Vec<Piece>, SubstitutionError> {
    Parser { text, rest: text, around }.pieces(Position::Text, 0)
}

/// The position of a text, which tells where it ends.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Position {
    /// A whole text; it ends with it.
    Text,
    /// An argument in quotes.
    Quoted(char),
    /// An argument without quotes; a space or `)` ends it.
    Bare,
    /// The same below a quoted argument, where ROS 2 takes quotes for plain text.
    BareInQuotes,
}

impl Position {
    /// Returns the position of the arguments of a substitution that stands here.
    fn arguments(self) -> Self {
        match self {
            Self::Text | Self::Bare => Self::Bare,
            Self::Quoted(_) | Self::BareInQuotes => Self::BareInQuotes,
        }
    }

    fn is_bare(self) -> bool {
        matches!(self, Self::Bare | Self::BareInQuotes)
    }
}

struct Parser<'a> {
    text: &'a str,
    rest: &'a str,
    around: Option<&'a Surroundings<'a>>,
}

impl Parser<'_> {
    fn take(&mut self) -> Option<char> {
        let c = self.rest.chars().next()?;
        self.rest = &self.rest[c.len_utf8()..];
        Some(c)
    }

    fn refuse<T>(&self, why: &str) -> Result<T, SubstitutionError> {
        Err(SubstitutionError(format!("'{}': {why}", self.text)))
    }

    fn pieces(&mut self, position: Position, depth: usize) -> Result<Vec<Piece>, SubstitutionError> {
        let mut pieces = Vec::new();
        loop {
            // A substitution is looked for first: it can stand in a text, in quotes and in a bare argument.
            if self.rest.starts_with("$(") {
                pieces.push(Piece::Value(self.call(position.arguments(), depth + 1)?));
                continue;
            }
            if position.is_bare() && self.rest.starts_with([' ', ')']) {
                return Ok(pieces);
            }
            let c = match (self.take(), position) {
                (None, Position::Text) => return Ok(pieces),
                (None, Position::Quoted(quote)) => {
                    return self.refuse(&format!("the quote {quote} does not end"));
                }
                (None, _) => return self.refuse("a substitution does not end, ')' is missing"),
                (Some('\\'), _) => self.escaped(position)?,
                (Some(c), Position::Quoted(quote)) if c == quote => return Ok(pieces),
                (Some('$'), _) => return self.refuse("a dollar without '(', write \\$ for a plain one"),
                (Some(c @ ('(' | '\'' | '"')), _) if position.is_bare() => {
                    return self.refuse(&format!("write \\{c} or quote the argument"));
                }
                (Some(c), _) => c,
            };
            match pieces.last_mut() {
                Some(Piece::Text(text)) => text.push(c),
                _ => pieces.push(Piece::Text(c.to_string())),
            }
        }
    }

    /// Reads the character behind a backslash.
    fn escaped(&mut self, position: Position) -> Result<char, SubstitutionError> {
        match self.take() {
            Some(' ') if position.is_bare() => self.refuse("quote an argument that has a space in it"),
            Some('\n') => self.refuse("a backslash before a line break has no meaning"),
            // ROS 2 looks one character back and takes what follows for escaped.
            Some('\\') if self.rest.starts_with(['$', '(', ')']) => {
                self.refuse("two backslashes before a dollar or a parenthesis are read in two ways")
            }
            c => Ok(c.unwrap_or('\\')),
        }
    }

    fn call(&mut self, position: Position, depth: usize) -> Result<String, SubstitutionError> {
        if depth > DEEPEST {
            return self.refuse("substitutions are nested too deeply");
        }
        self.rest = &self.rest["$(".len()..];
        // The name ends at the first character that cannot be part of a name.
        let end = self.rest.find([' ', ')', '$', '(', '\'', '"']).unwrap_or(self.rest.len());
        let (name, rest) = self.rest.split_at(end);
        let function = Function::named(name)?;
        self.rest = rest;
        let arguments = self.arguments(position, depth)?;
        function.check_count(arguments.len())?;
        self.around.map_or_else(|| Ok(String::new()), |around| function.value(&arguments, around))
    }

    fn arguments(&mut self, position: Position, depth: usize) -> Result<Vec<String>, SubstitutionError> {
        let mut arguments = Vec::new();
        loop {
            match self.take() {
                Some(')') => return Ok(arguments),
                // ROS 2 separates arguments by one space; with more of them the text is not what it seems.
                Some(' ') => {}
                None => return self.refuse("a substitution does not end, ')' is missing"),
                Some(_) => return self.refuse("a space is missing before an argument"),
            }
            let argument = match (self.rest.chars().next(), position) {
                (Some(' ' | ')'), _) => return self.refuse("one space, no more, goes before an argument"),
                // Below a quoted argument a quote would end the outer one: only a bare argument may have one.
                (Some(quote @ ('\'' | '"')), Position::Bare) => {
                    self.take();
                    self.pieces(Position::Quoted(quote), depth)?
                }
                _ => self.pieces(position, depth)?,
            };
            arguments.push(argument.iter().map(Piece::as_str).collect());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The pieces of a text where the variable `y z` is `1`, and `x1` is `value`.
    fn evaluated(text: &str) -> Result<Vec<Piece>, SubstitutionError> {
        let variables = [("y z", "1"), ("x1", "value"), ("a b')", "quoted"), ("", "none")];
        let variables = variables.map(|(name, value)| (name.to_owned(), value.to_owned())).into();
        pieces(text, Some(&Surroundings { file: "f".as_ref(), variables: &variables }))
    }

    /// The number of substitutions in a text, without those in the arguments of others.
    fn calls(pieces: &[Piece]) -> usize {
        pieces.iter().filter(|piece| matches!(piece, Piece::Value(_))).count()
    }

    /// The number of `$(` in a text whose dollar no backslash makes plain.
    fn openings(text: &str) -> usize {
        let plain = text.replace(r"\\", "").replace(r"\$", "");
        plain.matches("$(").count()
    }

    #[test]
    fn nests_and_joins() {
        let (a, b) = (Piece::Text("a/".into()), Piece::Text("b".into()));
        assert_eq!(
            evaluated("a/$(var x$(var 'y z'))b").expect("valid"),
            [a, Piece::Value("value".into()), b]
        );
    }

    #[test]
    fn escapes_are_plain() {
        for (text, plain) in [
            (r"\$(var x)", "$(var x)"),
            (r"5 \$ and \$x", "5 $ and $x"),
            (r"a\\b", r"a\b"),
            ("it's (\"fine\")", "it's (\"fine\")"),
            ("", ""),
            ("\\", "\\"),
        ] {
            let pieces = pieces(text, None).expect("valid");
            assert_eq!(
                (calls(&pieces), pieces.iter().map(Piece::as_str).collect()),
                (0, plain.to_owned()),
                "{text}"
            );
        }
    }

    #[test]
    fn arguments_may_be_quoted_and_escaped() {
        for text in [r#"$(var "a b')")"#, r"$(var 'a b\')')", r#"$(var "a b\')")"#] {
            assert_eq!(evaluated(text).expect(text), [Piece::Value("quoted".into())], "{text}");
        }
        assert_eq!(evaluated("$(var '')").expect("valid"), [Piece::Value("none".into())]);
    }

    #[test]
    fn refusals_say_what_is_possible() {
        for (text, message) in [
            ("$(var x", "')' is missing"),
            ("$(var 'x)", "the quote ' does not end"),
            ("$(var", "')' is missing"),
            ("$(vra x)", "$(vra) is not supported, supported are var, env, dirname, find-pkg-share, not, if"),
            ("$(eval '1 + 1')", "$(eval) is not supported"),
            ("$(var)", "$(var) takes 1 or 2 arguments, not 0"),
            ("$(dirname x)", "$(dirname) takes no argument, not 1"),
            ("$(not a b)", "$(not) takes 1 argument, not 2"),
            ("$(var a(b)", "write \\( or quote"),
            ("$(var 'a''b')", "a space is missing"),
            ("$(env  X)", "one space, no more"),
            ("$(var x )", "one space, no more"),
            ("5 $", "write \\$ for a plain one"),
            (r"\\$(var x)", "two backslashes before"),
            (r"$(env X a\ b)", "quote an argument that has a space"),
            ("$(var '$(var \"y\")')", "write \\\" or quote"),
        ] {
            let error = pieces(text, None).expect_err(text).to_string();
            assert!(error.contains(message), "{error}");
        }
        assert!(pieces(&"$(var ".repeat(10_000), None).is_err());
    }

    proptest! {
        #[test]
        fn each_substitution_of_a_text_is_parsed_or_the_text_is_refused(
            text in r#"(\$\((var|env|not)? |\)|[ a-z()$'"\\é]){0,12}"#,
        ) {
            match pieces(&text, None) {
                // Those in the arguments of others are not counted.
                Ok(pieces) => prop_assert!(calls(&pieces) <= openings(&text) && (calls(&pieces) > 0) == (openings(&text) > 0)),
                Err(why) => {
                    prop_assert!(text.contains(['$', '\\']), "{why}");
                    prop_assert!(why.to_string().contains("$(") || why.to_string().contains(&text), "{why}");
                }
            }
        }

        #[test]
        fn quoting_any_text_keeps_it(text in "\\PC{0,20}") {
            let escaped: String =
                text.chars().filter(|c| *c != '\\').flat_map(|c| ['\\', c]).collect();
            let value = format!("$(if 1 '{escaped}')");
            prop_assert_eq!(evaluated(&value).expect("valid"), [Piece::Value(text.replace('\\', ""))]);
        }
    }
}
