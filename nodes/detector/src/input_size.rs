//! [`InputSize`]: how large a tensor the model gets, as parameter and as rule.

use std::fmt;

use modulo_core::Letterbox;
use modulo_core::letterbox::{Align, LetterboxError, Scaling};

/// The stride of most models: sides are multiples of it.
pub const STRIDE: usize = 32;
/// A model that keeps its best 300 cells needs at least as many: 128 x 128 has 336 on strides 8, 16 and 32.
const LEAST: usize = 128;
/// Largest side: every client of the node may set the size, and the tensors of a network take several GB beyond this.
const MOST: usize = 2048;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputSize {
    /// The image, padded right and below to multiples of this stride; never resized.
    Auto(usize),
    /// The image is centred in this (height, width), and scaled down where it is larger.
    Fixed(usize, usize),
}

impl InputSize {
    /// Reads `auto` or `WxH` for a model of this `stride` that fixes `of_model` (height, width) or nothing.
    pub fn parse(text: &str, of_model: Option<(usize, usize)>, stride: usize) -> Result<Self, String> {
        let asked = match text.trim() {
            "auto" => None,
            text => Some(sides(text, stride).ok_or_else(|| {
                format!("must be auto or WIDTHxHEIGHT, multiples of {stride} in {stride} to {MOST}, such as 640x384")
            })?),
        };
        match (asked, of_model) {
            (None, None) => Ok(Self::Auto(stride)),
            (Some((height, width)), None) => Ok(Self::Fixed(height, width)),
            (asked, Some((height, width))) if asked.is_none_or(|asked| asked == (height, width)) => {
                Ok(Self::Fixed(height, width))
            }
            (_, Some((height, width))) => {
                Err(format!("this model takes {width}x{height} only; set that or auto"))
            }
        }
    }

    /// Returns (height, width) of the tensor for an image of `height x width`.
    pub fn tensor(self, height: usize, width: usize) -> (usize, usize) {
        match self {
            Self::Auto(stride) => {
                let padded = |side: usize| side.max(LEAST).next_multiple_of(stride);
                (padded(height), padded(width))
            }
            Self::Fixed(height, width) => (height, width),
        }
    }

    /// Returns (height, width) of the tensors for images of these sizes, each one once.
    pub fn tensors(self, images: &[(usize, usize)]) -> Vec<(usize, usize)> {
        let mut sizes = Vec::new();
        for size in images.iter().map(|&(height, width)| self.tensor(height, width)) {
            if !sizes.contains(&size) {
                sizes.push(size);
            }
        }
        sizes
    }

    /// Returns the position of an image of `height x width` in the tensor.
    pub fn place(self, height: usize, width: usize) -> Result<Letterbox, LetterboxError> {
        let align = match self {
            Self::Auto(_) => Align::TopLeft,
            Self::Fixed(..) => Align::Centre,
        };
        Letterbox::new((height, width), self.tensor(height, width), align, Scaling::ShrinkOnly)
    }
}

impl fmt::Display for InputSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto(_) => write!(f, "auto"),
            Self::Fixed(height, width) => write!(f, "{width}x{height}"),
        }
    }
}

/// Returns (height, width) of `WxH`.
fn sides(text: &str, stride: usize) -> Option<(usize, usize)> {
    let (width, height) = text.split_once(['x', 'X'])?;
    let side =
        |text: &str| text.parse().ok().filter(|side| (stride..=MOST).contains(side) && side % stride == 0);
    Some((side(height)?, side(width)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    const AUTO: InputSize = InputSize::Auto(STRIDE);

    #[test]
    fn width_comes_first() {
        assert_eq!(InputSize::parse("640x384", None, STRIDE), Ok(InputSize::Fixed(384, 640)));
        assert!(InputSize::parse("2048x2048", None, STRIDE).is_ok());
        assert_eq!(InputSize::Fixed(384, 640).to_string(), "640x384");
        assert_eq!(AUTO.tensor(375, 1242), (384, 1248));
        assert_eq!(AUTO.tensor(1, 160), (128, 160));
    }

    #[test]
    fn a_model_of_a_larger_stride_gets_multiples_of_it() {
        let auto = InputSize::parse("auto", None, 64).expect("possible");
        assert_eq!((auto.tensor(375, 1242), auto.tensor(1, 129)), ((384, 1280), (128, 192)));
        assert!(InputSize::parse("1248x384", None, 64).expect_err("no multiple").contains("multiples of 64"));
    }

    #[test]
    fn impossible_sizes_say_what_is_possible() {
        for bad in
            ["", "640", "640x", "x640", "640x100", "0x640", "-32x32", "640x2080", "99999968x640", "640x640x3"]
        {
            let why = InputSize::parse(bad, None, STRIDE).expect_err(bad);
            assert!(why.contains("auto") && why.contains("multiples of 32 in 32 to 2048"), "{why}");
        }
    }

    #[test]
    fn a_static_model_takes_its_own_size_alone() {
        let own = InputSize::Fixed(480, 640);
        for possible in ["auto", "640x480"] {
            assert_eq!(InputSize::parse(possible, Some((480, 640)), STRIDE), Ok(own));
        }
        assert!(
            InputSize::parse("640x640", Some((480, 640)), STRIDE)
                .expect_err("other size")
                .contains("640x480")
        );
    }
}
