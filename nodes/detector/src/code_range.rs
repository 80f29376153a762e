//! [`CodeRange`]: notices images of 16 bits whose codes use fewer, as those of most cameras of 10, 12 or 14 bits do.

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
    /// Takes note of an image that is read with the whole range of its encoding. Returns the text of a warning once, when no code
    /// so far needs 16 bits. An image of 0 says nothing.
    pub fn note(&mut self, frame: &Frame) -> Option<String> {
        let Samples::U16(codes) = frame.samples() else { return None };
        if self.warned || self.bits().is_none() {
            return None;
        }
        self.largest = codes.iter().copied().fold(self.largest, u16::max);
        let bits = self.bits().filter(|_| self.largest > 0)?;
        self.warned = true;
        Some(format!(
            "images of 16 bits have no code above {}, as from a camera of {bits} bits, and are read as nearly black: set the \
             parameter bits to {bits}, or to 16 if the images really are dark",
            self.largest
        ))
    }

    /// Returns the bits that the codes so far need; `None` if these are more than a camera of fewer than 16 bits has.
    fn bits(&self) -> Option<u8> {
        FEWER_BITS.into_iter().find(|&bits| self.largest >> bits == 0)
    }
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
            assert_eq!(range.note(&image(0)), None, "a cap on the lens");
            let warning = range.note(&image(largest)).expect("a warning");
            let told = [format!("no code above {largest},"), format!("bits to {bits}, or to 16")];
            assert!(told.iter().all(|text| warning.contains(text)), "{warning}");
            assert_eq!(range.note(&image(largest)), None, "told already");
        }
    }

    #[test]
    fn a_camera_of_16_bits_may_go_dark() {
        let mut range = CodeRange::default();
        assert_eq!([16384, 300].map(|largest| range.note(&image(largest))), [None, None]);
        let eight = Frame::from_u8(Array3::from_elem((2, 3, 1), 9)).expect("a frame");
        assert_eq!(CodeRange::default().note(&eight), None);
    }
}
