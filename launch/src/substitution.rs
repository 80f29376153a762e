//! Texts with substitutions `$(name arguments)`, in the grammar of ROS 2's `launch` frontend. Every string of a launch file
//! can be such a text. Nothing is executed here, and no Python or shell is ever evaluated.
//!
//! A backslash makes the next character plain; a dollar that opens no substitution needs one. Within `$(...)` arguments are
//! separated by one space each, may be quoted with `'` or `"`, and nest. A text that ROS 2 reads otherwise is refused.

mod function;

pub(crate) use function::truth;
pub use function::{Function, Surroundings};

/// No launch file nests substitutions deeper than this; keeps recursion bounded.
const DEEPEST: usize = 32;

/// A parsed text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Template {
    /// Its pieces, to be joined.
    pub parts: Vec<Part>,
}

/// A piece of a text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Part {
    /// Plain text.
    Text(String),
    /// `$(function arguments)`.
    Call(&'static Function, Vec<Template>),
}

/// Why a text is not a valid template, or has no value: what is wrong and what is possible.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SubstitutionError(pub(crate) String);

impl Template {
    /// Parses `text`.
    ///
    /// # Errors
    /// [`SubstitutionError`] for a substitution without an end, an unknown one, or a wrong count.
    pub fn parse(text: &str) -> Result<Self, SubstitutionError> {
        let mut parser = TemplateParser { text, rest: text };
        parser.template(TemplatePosition::Text, 0)
    }

    /// A text without substitutions.
    pub fn plain(text: impl Into<String>) -> Self {
        Self { parts: vec![Part::Text(text.into())] }
    }

    /// The text, when there is no substitution in it.
    pub fn as_plain(&self) -> Option<&str> {
        match self.parts.as_slice() {
            [] => Some(""),
            [Part::Text(text)] => Some(text),
            _ => None,
        }
    }

    fn push(&mut self, c: char) {
        match self.parts.last_mut() {
            Some(Part::Text(text)) => text.push(c),
            _ => self.parts.push(Part::Text(c.to_string())),
        }
    }
}

/// The position of a template, which tells where it ends.
#[derive(Clone, Copy, PartialEq, Eq)]
enum TemplatePosition {
    /// A whole text; it ends with it.
    Text,
    /// An argument in quotes.
    Quoted(char),
    /// An argument without quotes; a space or `)` ends it.
    Bare,
    /// The same below a quoted argument, where ROS 2 takes quotes for plain text.
    BareInQuotes,
}

impl TemplatePosition {
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

struct TemplateParser<'a> {
    text: &'a str,
    rest: &'a str,
}

impl TemplateParser<'_> {
    fn take(&mut self) -> Option<char> {
        let c = self.rest.chars().next()?;
        self.rest = &self.rest[c.len_utf8()..];
        Some(c)
    }

    fn refuse<T>(&self, why: &str) -> Result<T, SubstitutionError> {
        Err(SubstitutionError(format!("'{}': {why}", self.text)))
    }

    fn template(&mut self, position: TemplatePosition, depth: usize) -> Result<Template, SubstitutionError> {
        let mut template = Template::default();
        loop {
            // A substitution is looked for first: it can stand in a text, in quotes and in a bare argument.
            if self.rest.starts_with("$(") {
                template.parts.push(self.call(position.arguments(), depth + 1)?);
                continue;
            }
            if position.is_bare() && self.rest.starts_with([' ', ')']) {
                return Ok(template);
            }
            match (self.take(), position) {
                (None, TemplatePosition::Text) => return Ok(template),
                (None, TemplatePosition::Quoted(quote)) => {
                    return self.refuse(&format!("the quote {quote} does not end"));
                }
                (None, _) => return self.refuse("a substitution does not end, ')' is missing"),
                (Some('\\'), _) => template.push(self.escaped(position)?),
                (Some(c), TemplatePosition::Quoted(quote)) if c == quote => return Ok(template),
                (Some('$'), _) => return self.refuse("a dollar without '(', write \\$ for a plain one"),
                (Some(c @ ('(' | '\'' | '"')), _) if position.is_bare() => {
                    return self.refuse(&format!("write \\{c} or quote the argument"));
                }
                (Some(c), _) => template.push(c),
            }
        }
    }

    /// Reads the character behind a backslash.
    fn escaped(&mut self, position: TemplatePosition) -> Result<char, SubstitutionError> {
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

    fn call(&mut self, position: TemplatePosition, depth: usize) -> Result<Part, SubstitutionError> {
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
        Ok(Part::Call(function, arguments))
    }

    fn arguments(
        &mut self,
        position: TemplatePosition,
        depth: usize,
    ) -> Result<Vec<Template>, SubstitutionError> {
        let mut arguments = Vec::new();
        loop {
            match self.take() {
                Some(')') => return Ok(arguments),
                // ROS 2 separates arguments by one space; with more of them the text is not what it seems.
                Some(' ') => {}
                None => return self.refuse("a substitution does not end, ')' is missing"),
                Some(_) => return self.refuse("a space is missing before an argument"),
            }
            match (self.rest.chars().next(), position) {
                (Some(' ' | ')'), _) => return self.refuse("one space, no more, goes before an argument"),
                // Below a quoted argument a quote would end the outer one: only a bare argument may have one.
                (Some(quote @ ('\'' | '"')), TemplatePosition::Bare) => {
                    self.take();
                    arguments.push(self.template(TemplatePosition::Quoted(quote), depth)?);
                }
                _ => arguments.push(self.template(position, depth)?),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn call(function: &str, arguments: Vec<Template>) -> Part {
        Part::Call(Function::named(function).expect("known"), arguments)
    }

    /// The number of substitutions in a template.
    fn calls(template: &Template) -> usize {
        let call = |part: &Part| match part {
            Part::Text(_) => 0,
            Part::Call(_, arguments) => 1 + arguments.iter().map(calls).sum::<usize>(),
        };
        template.parts.iter().map(call).sum()
    }

    /// The number of `$(` in a text whose dollar no backslash makes plain.
    fn openings(text: &str) -> usize {
        let plain = text.replace(r"\\", "").replace(r"\$", "");
        plain.matches("$(").count()
    }

    #[test]
    fn nests_and_joins() {
        let template = Template::parse("a/$(var x$(var 'y z'))b").expect("valid");
        let inner = call("var", vec![Template::plain("y z")]);
        let name = Template { parts: vec![Part::Text("x".into()), inner] };
        let outer = call("var", vec![name]);
        assert_eq!(template.parts, [Part::Text("a/".into()), outer, Part::Text("b".into())]);
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
            assert_eq!(Template::parse(text).expect("valid").as_plain(), Some(plain), "{text}");
        }
    }

    #[test]
    fn arguments_may_be_quoted_and_escaped() {
        let expected = [call("env", vec![Template::plain("X"), Template::plain("a b')")])];
        for text in [r#"$(env X "a b')")"#, r"$(env X 'a b\')')", r#"$(env X "a b\')")"#] {
            assert_eq!(Template::parse(text).expect(text).parts, expected, "{text}");
        }
        assert_eq!(
            Template::parse("$(env X '')").expect("valid").parts,
            [call("env", vec![Template::plain("X"), Template::default()])]
        );
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
            let error = Template::parse(text).expect_err(text).to_string();
            assert!(error.contains(message), "{error}");
        }
        assert!(Template::parse(&"$(var ".repeat(10_000)).is_err());
    }

    proptest! {
        #[test]
        fn each_substitution_of_a_text_is_parsed_or_the_text_is_refused(
            text in r#"(\$\((var|env|not)? |\)|[ a-z()$'"\\é]){0,12}"#,
        ) {
            match Template::parse(&text) {
                Ok(template) => prop_assert_eq!(calls(&template), openings(&text)),
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
            let parsed = Template::parse(&format!("$(var '{escaped}')")).expect("valid");
            let Part::Call(_, arguments) = &parsed.parts[0] else { panic!("a call") };
            prop_assert_eq!(arguments[0].as_plain().map(str::to_owned), Some(text.replace('\\', "")));
        }
    }
}
