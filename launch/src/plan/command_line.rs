//! Splitting a command line into words as a shell would, without running one:
//! quotes group, a backslash makes the next character plain, and the value of a
//! substitution is never split. As in ROS 2, no quote spans a substitution.

use crate::substitution::{Part, SubstitutionError, Surroundings, Template};

/// The words of `template`.
///
/// # Errors
/// [`SubstitutionError`] for a quote that does not end or spans a substitution,
/// and for a substitution without a value.
pub(super) fn words(
    template: &Template,
    around: &Surroundings<'_>,
) -> Result<Vec<String>, SubstitutionError> {
    let mut splitter = Splitter::default();
    for part in &template.parts {
        match part {
            Part::Text(text) => splitter.text(text),
            Part::Call(..) if splitter.quote.is_some() => {
                let why = "a quote spans a substitution; leave it out, the value is one word anyway";
                return Err(SubstitutionError::Invalid(why.to_owned()));
            }
            Part::Call(..) => splitter.word.get_or_insert_default().push_str(&part.evaluate(around)?),
        }
    }
    splitter.finish()
}

#[derive(Default)]
struct Splitter {
    words: Vec<String>,
    word: Option<String>,
    quote: Option<char>,
}

impl Splitter {
    fn text(&mut self, text: &str) {
        let mut chars = text.chars();
        while let Some(c) = chars.next() {
            match (c, self.quote) {
                (c, Some(quote)) if c == quote => self.quote = None,
                ('\\', None | Some('"')) => self.push(chars.next().unwrap_or('\\')),
                (c @ ('\'' | '"'), None) => {
                    self.quote = Some(c);
                    self.word.get_or_insert_default();
                }
                (c, None) if c.is_whitespace() => self.words.extend(self.word.take()),
                (c, _) => self.push(c),
            }
        }
    }

    fn push(&mut self, c: char) {
        self.word.get_or_insert_default().push(c);
    }

    fn finish(mut self) -> Result<Vec<String>, SubstitutionError> {
        if let Some(quote) = self.quote {
            return Err(SubstitutionError::Invalid(format!("the quote {quote} does not end")));
        }
        self.words.extend(self.word);
        Ok(self.words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn split(text: &str) -> Result<Vec<String>, SubstitutionError> {
        let variables = [("v".to_owned(), "a b".to_owned())].into();
        let environment = Default::default();
        let file = std::path::Path::new("f");
        let around = Surroundings { file, variables: &variables, environment: &environment };
        words(&Template::parse(text)?, &around)
    }

    #[test]
    fn splits_as_a_shell() {
        assert_eq!(
            split("sh -c 'echo \"x y\"' $(var v)z").expect("valid"),
            ["sh", "-c", "echo \"x y\"", "a bz"]
        );
        assert_eq!(split("a '' b\"c d\"e").expect("valid"), ["a", "", "bc de"]);
        assert!(split("'-p $(var v)'").is_err());
        assert!(split("  ").expect("valid").is_empty());
        assert!(split("'a").is_err());
    }

    proptest! {
        #[test]
        fn quoted_words_come_back(words in prop::collection::vec("[a-z \"]{0,6}", 0..5)) {
            let line: Vec<String> = words.iter().map(|w| format!("'{w}'")).collect();
            prop_assert_eq!(split(&line.join(" ")).expect("valid"), words);
        }
    }
}
