//! [`Head`]: the forms in which models give boxes, and which of them a model has.

use std::fmt;

/// The possible forms, for people.
pub const FORMS: &str = "an output of float32 with boxes: [1, N, 6] (x1, y1, x2, y2, score, class), [1, 4 + C, N] (centre, size and the \
                         scores of C classes) or [1, N, 5 + C] (also an objectness), as 'yolo export model=FILE.pt format=onnx' writes it";

/// The form of an output without its first side, which is 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Head {
    /// N x 6: x1, y1, x2, y2, score, class. The model itself leaves one box an object.
    EndToEnd,
    /// (4 + classes) x N: centre, size and the score of each class, an anchor in each column, as of YOLOv8 and later ones.
    Columns { classes: usize },
    /// N x (5 + classes): centre, size, objectness and the score of each class, an anchor in each row, as of YOLOv5 and YOLOv7.
    Rows { classes: usize },
}

impl fmt::Display for Head {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::EndToEnd => write!(f, "[1, N, 6]: x1, y1, x2, y2, score, class"),
            Self::Columns { classes } => write!(f, "[1, {}, N]: centre, size, class scores", 4 + classes),
            Self::Rows { classes } => {
                write!(f, "[1, N, {}]: centre, size, objectness, class scores", 5 + classes)
            }
        }
    }
}

/// A form that leaves the removal of overlapping boxes to the reader.
struct Raw {
    head: Head,
    classes: usize,
    /// Whether the output has as many boxes as an input of this size has anchors.
    has_anchors: bool,
}

impl Head {
    /// Returns the form of an output of `rows` x `columns` for an input of (height, width). What the model says (`end_to_end`), its number of
    /// names (0: it has none) and the number of anchors decide; an output that may have two forms is refused.
    pub fn of(
        (rows, columns): (usize, usize),
        input: (usize, usize),
        (end_to_end, named): (Option<bool>, usize),
    ) -> Result<Self, String> {
        let shape = format!("output is [1, {rows}, {columns}]");
        if end_to_end == Some(true) {
            let why = || format!("{shape}, and its metadata (end2end, nms) says [1, N, 6]; export it again");
            return (columns == 6).then_some(Self::EndToEnd).ok_or_else(why);
        }
        let (may_be_finished, is_raw) = (columns == 6 && end_to_end.is_none(), end_to_end == Some(false));
        let raw = raw_forms((rows, columns), input);
        let is_possible = |raw: &&Raw| match named {
            0 => raw.classes > 0 && (raw.has_anchors || is_raw && raw.head == Self::Rows { classes: 1 }),
            _ => raw.classes == named,
        };
        let mut possible: Vec<_> = raw.iter().filter(is_possible).collect();
        if possible.len() > 1 {
            possible.retain(|raw| raw.has_anchors);
        }
        match possible[..] {
            [] if may_be_finished => Ok(Self::EndToEnd),
            [] => Err(no_form(&shape, columns, &raw, named)),
            [one] if !may_be_finished => Ok(one.head),
            // The boxes of an export that has removed overlaps are not as many as the anchors.
            [Raw { has_anchors: false, .. }] => Ok(Self::EndToEnd),
            [one] if named > 0 => Ok(one.head),
            [one, ..] => {
                let tell =
                    "set the metadata property end2end to True for the first one, to False for the other one";
                Err(format!("{shape}, which may be {} or {}; {tell}", Self::EndToEnd, one.head))
            }
        }
    }

    /// Returns the number of classes of a form whose overlapping boxes are still to be removed.
    pub fn classes_to_suppress(self) -> Option<usize> {
        match self {
            Self::EndToEnd => None,
            Self::Columns { classes } | Self::Rows { classes } => Some(classes),
        }
    }

    /// Returns a warning where only the anchors of the input or only the names tell that an output of these sides has this form.
    pub fn doubt(
        self,
        (rows, columns): (usize, usize),
        input: (usize, usize),
        end_to_end: Option<bool>,
    ) -> Option<String> {
        let raw = raw_forms((rows, columns), input).into_iter().find(|raw| raw.head == self)?;
        let read = format!("output [1, {rows}, {columns}] is read as {self}");
        if !raw.has_anchors {
            return Some(format!(
                "{read}, and has not as many boxes as an input of {} x {} has anchors",
                input.0, input.1
            ));
        }
        (end_to_end.is_none() && columns == 6).then(|| {
            let tell = "set the metadata property end2end to False if that is right, else to True";
            format!("{read}, not as {}, since it has a row for each anchor; {tell}", Self::EndToEnd)
        })
    }

    /// Returns whether an output of these sides has this form.
    pub fn fits(self, (rows, columns): (usize, usize)) -> bool {
        match self {
            Self::EndToEnd => columns == 6,
            Self::Columns { classes } => rows == 4 + classes,
            Self::Rows { classes } => columns == 5 + classes,
        }
    }
}

fn raw_forms((rows, columns): (usize, usize), input: (usize, usize)) -> [Raw; 2] {
    let has_anchors = |finest: &[usize], anchors| anchor_counts(finest, input).any(|count| count == anchors);
    let by_column = rows.saturating_sub(4);
    // A YOLOX has such rows for one anchor a cell, and its boxes and colours are others.
    let by_row = if has_anchors(&[4, 8, 16], rows) { 0 } else { columns.saturating_sub(5) };
    [
        Raw {
            head: Head::Columns { classes: by_column },
            classes: by_column,
            has_anchors: has_anchors(&[4, 8, 16], columns),
        },
        // Each cell has three anchors. On strides 16 and 32 alone, as of a tiny YOLOv3, an input of 160 x 128 would have 300.
        Raw {
            head: Head::Rows { classes: by_row },
            classes: by_row,
            has_anchors: rows % 3 == 0 && has_anchors(&[4, 8], rows / 3),
        },
    ]
}

/// Returns the numbers of cells of the networks that are in use for an input of (height, width): their strides double from one of the
/// `finest` up to 32, 64 or 128.
fn anchor_counts(finest: &[usize], (height, width): (usize, usize)) -> impl Iterator<Item = usize> {
    let count = move |first: usize, last: usize| {
        let strides = std::iter::successors(Some(first), |stride| Some(2 * stride));
        strides.take_while(|stride| *stride <= last).map(|stride| (height / stride) * (width / stride)).sum()
    };
    let coarsest = [32, 64, 128].into_iter().filter(move |last| height % last == 0 && width % last == 0);
    finest.iter().flat_map(move |&first| coarsest.clone().map(move |last| count(first, last)))
}

/// Returns the reason for which an output has none of the forms.
fn no_form(shape: &str, columns: usize, raw: &[Raw], named: usize) -> String {
    if let Some(Raw { classes, .. }) = raw.iter().find(|raw| raw.has_anchors && raw.classes > 0) {
        return format!(
            "{shape}, with the scores of {classes} classes, and the model has names of {named}: correct its metadata property names"
        );
    }
    let looks = if named > 0 && columns == 4 + named { ", as of an RT-DETR" } else { "" };
    format!("{shape}{looks}, needed is {FORMS}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const VGA: (usize, usize) = (640, 640);

    #[test]
    fn exports_of_ultralytics_have_one_form() {
        let (v8, v5) = (Head::Columns { classes: 80 }, Head::Rows { classes: 80 });
        // With and without names, and with what a model says of itself.
        for named in [0, 80] {
            for told in [None, Some(false)] {
                assert_eq!(Head::of((84, 8400), VGA, (told, named)), Ok(v8));
                assert_eq!(Head::of((84, 9828), (384, 1248), (told, named)), Ok(v8));
                assert_eq!(Head::of((84, 34_000), VGA, (told, named)), Ok(v8), "strides 4 to 32");
                assert_eq!(Head::of((84, 8500), VGA, (told, named)), Ok(v8), "strides 8 to 64");
                assert_eq!(Head::of((84, 2000), VGA, (told, named)), Ok(v8), "strides 16 and 32");
                assert_eq!(Head::of((25_200, 85), VGA, (told, named)), Ok(v5));
                assert_eq!(Head::of((25_500, 85), VGA, (told, named)), Ok(v5), "strides 8 to 64");
            }
            assert_eq!(Head::of((300, 6), VGA, (None, named)), Ok(Head::EndToEnd));
            assert_eq!(Head::of((300, 6), VGA, (Some(true), named)), Ok(Head::EndToEnd));
        }
        // One class, two classes, and as few boxes as a test has.
        assert_eq!(Head::of((5, 8400), VGA, (None, 1)), Ok(Head::Columns { classes: 1 }));
        assert_eq!(Head::of((6, 8400), VGA, (None, 2)), Ok(Head::Columns { classes: 2 }));
        assert_eq!(Head::of((300, 6), VGA, (None, 1)), Ok(Head::EndToEnd));
        assert_eq!(
            Head::of((300, 6), (128, 160), (None, 1)),
            Ok(Head::EndToEnd),
            "three anchors on strides 16 and 32"
        );
        assert_eq!(Head::of((7, 9), VGA, (None, 3)), Ok(Head::Columns { classes: 3 }));
        assert_eq!(Head::of((9, 8), VGA, (None, 3)), Ok(Head::Rows { classes: 3 }));
    }

    #[test]
    fn what_may_be_two_forms_is_decided_by_what_the_model_says() {
        let (rows, input) = ((4032, 6), (256, 256));
        let one_class = Head::Rows { classes: 1 };
        assert_eq!(Head::of(rows, input, (None, 1)), Ok(one_class));
        assert_eq!(Head::of(rows, input, (Some(false), 0)), Ok(one_class));
        assert_eq!(Head::of(rows, input, (Some(true), 0)), Ok(Head::EndToEnd));
        assert_eq!(Head::of(rows, input, (None, 3)), Ok(Head::EndToEnd));
        assert_eq!(Head::of((300, 6), VGA, (Some(false), 0)), Ok(one_class), "without as many anchors");
        let why = Head::of(rows, input, (None, 0)).expect_err("two forms");
        assert!(
            why.contains("[1, 4032, 6]") && why.contains("end2end to True") && why.contains("False"),
            "{why}"
        );
    }

    #[test]
    fn what_only_the_anchors_or_only_the_names_tell_is_doubted() {
        let (one_class, input) = (Head::Rows { classes: 1 }, (256, 256));
        let doubt = one_class.doubt((4032, 6), input, None).expect("a doubt");
        assert!(doubt.contains("[1, 4032, 6]") && doubt.contains("end2end to False"), "{doubt}");
        assert_eq!(one_class.doubt((4032, 6), input, Some(false)), None);
        let doubt = Head::Columns { classes: 3 }.doubt((7, 9), VGA, Some(false)).expect("a doubt");
        assert!(doubt.contains("[1, 7, 9]") && doubt.contains("640 x 640"), "{doubt}");
        for (head, sides) in [
            (Head::Columns { classes: 80 }, (84, 8400)),
            (Head::Rows { classes: 80 }, (25_200, 85)),
            (Head::EndToEnd, (300, 6)),
        ] {
            assert_eq!(head.doubt(sides, VGA, None), None);
        }
    }

    #[test]
    fn what_is_no_form_or_contradicts_itself_is_refused() {
        for (sides, told, parts) in [
            ((84, 8400), (Some(true), 80), ["[1, 84, 8400]", "end2end"]),
            ((300, 6), (Some(false), 80), ["[1, 300, 6]", "[1, N, 5 + C]"]),
            ((84, 8400), (None, 3), ["scores of 80 classes", "names of 3"]),
            ((25_200, 85), (Some(false), 3), ["scores of 80 classes", "names of 3"]),
            ((116, 8400), (None, 80), ["scores of 112 classes", "names of 80"]),
            ((300, 84), (None, 80), ["RT-DETR", "[1, 4 + C, N]"]),
            ((8400, 84), (None, 80), ["[1, 8400, 84]", "[1, 4 + C, N]"]),
            ((8400, 85), (None, 80), ["[1, 8400, 85]", "[1, N, 5 + C]"]),
            ((84, 8399), (None, 0), ["[1, 84, 8399]", "[1, 4 + C, N]"]),
            ((4, 8400), (None, 0), ["[1, 4, 8400]", "[1, 4 + C, N]"]),
            ((0, 0), (None, 0), ["[1, 0, 0]", "[1, 4 + C, N]"]),
        ] {
            let why = Head::of(sides, VGA, told).expect_err("no form");
            assert!(parts.iter().all(|part| why.contains(part)), "{why}");
        }
    }
}
