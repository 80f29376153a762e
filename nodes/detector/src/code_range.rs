//! [`CodeRange`]: notices images whose codes use fewer bits than their encoding has, as those of most cameras of 10, 12 or 14 bits do.

use modulo_core::{Frame, Samples};

/// The bits of a converter whose codes are mistaken for dark images when they are read as 16 bits.
const FEWER_BITS: [u8; 4] = [8, 10, 12, 14];

/// The largest code that the images of a camera have had.
#[derive(Default)]
pub struct CodeRange {
    largest: u16,
    warned: bool,
}

impl CodeRange {
    /// Takes note of an image that is read with the whole range of its encoding, beside which a camera with a sensor of `described` bits may
    /// have described itself. Returns the text of a warning once, when no code so far needs more bits than the camera has, or than cameras of
    /// fewer than 16 have. An image of 0 says nothing.
    pub fn note(&mut self, frame: &Frame, described: Option<u8>) -> Option<String> {
        let depth = frame.depth();
        let fewer = described.filter(|&bits| bits < depth);
        let bits = |largest: u16| {
            let usual = FEWER_BITS.into_iter().filter(|_| depth == 16);
            fewer.into_iter().chain(usual).find(|&bits| largest >> bits == 0)
        };
        if self.warned || bits(self.largest).is_none() {
            return None;
        }
        self.largest = self.largest.max(match frame.samples() {
            Samples::U8(codes) => most(codes.as_slice()?).into(),
            Samples::U16(codes) => most(codes.as_slice()?),
            Samples::F32(_) => return None,
        });
        let bits = bits(self.largest).filter(|_| self.largest > 0)?;
        self.warned = true;
        Some(format!(
            "images of {depth} bits have no code above {}, as from a camera of {bits} bits, and are read as nearly black: set the \
             parameter bits to {bits}, or to {depth} if the images really are dark",
            self.largest
        ))
    }
}

fn most<T: Copy + Ord + Default>(codes: &[T]) -> T {
    codes.iter().copied().max().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;

    fn image(largest: u16) -> Frame {
        let pixels = Array3::from_shape_fn((2, 3, 1), |(i, j, _)| if (i, j) == (1, 2) { largest } else { 0 });
        Frame::from_u16(pixels).expect("a frame")
    }

    #[test]
    fn codes_of_fewer_bits_are_named_once() {
        for (largest, bits) in
            [(200, 8), (256, 10), (1023, 10), (1024, 12), (4095, 12), (4096, 14), (16383, 14)]
        {
            let mut range = CodeRange::default();
            assert_eq!(range.note(&image(0), None), None, "a cap on the lens");
            let warning = range.note(&image(largest), None).expect("a warning");
            let expected = [format!("no code above {largest},"), format!("bits to {bits}, or to 16")];
            assert!(expected.iter().all(|text| warning.contains(text)), "{warning}");
            assert_eq!(range.note(&image(largest), None), None, "told already");
        }
    }

    #[test]
    fn a_camera_of_16_bits_may_go_dark() {
        let mut range = CodeRange::default();
        assert_eq!([16384, 300].map(|largest| range.note(&image(largest), None)), [None, None]);
        let eight = Frame::from_u8(Array3::from_elem((2, 3, 1), 9)).expect("a frame");
        assert_eq!(CodeRange::default().note(&eight, None), None);
    }
}
