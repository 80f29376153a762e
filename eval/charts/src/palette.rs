//! [`class_colour`]: the colour of a class of objects.

use crate::primitives::{Colour, WHITE};

/// The colours with the names of common classes. Each colour is visible on dark and on bright images.
const CLASSES: [(Colour, &[&str]); 12] = [
    ([0xff, 0x9f, 0x1c], &["car"]),
    ([0xff, 0x4d, 0x8d], &["pedestrian", "person"]),
    ([0x00, 0xc8, 0x96], &["cyclist", "rider"]),
    ([0x4c, 0xb4, 0xff], &["van"]),
    ([0xb0, 0x7c, 0xff], &["truck"]),
    ([0xe8, 0x50, 0x20], &["bus"]),
    ([0xa8, 0xd8, 0x30], &["bicycle", "bike"]),
    ([0x20, 0xd8, 0xe8], &["motorcycle", "motorbike"]),
    ([0x3a, 0x6c, 0xf0], &["tram", "train"]),
    ([0xf4, 0xe4, 0x30], &["traffic light"]),
    ([0xe0, 0x90, 0xd8], &["traffic sign", "stop sign"]),
    ([0xc0, 0x90, 0x60], &["dog"]),
];

/// The colour of the boxes of class `name`. It depends on the name only, so that a class has the same colour in all images
/// of all models. Names beyond the common ones of road scenes share the colours.
pub fn class_colour(name: &str) -> Colour {
    let known = |names: &&[&str]| names.iter().any(|known| known.eq_ignore_ascii_case(name));
    let common = CLASSES.iter().position(|(_, names)| known(names));
    // The hash FNV-1a.
    let hash =
        name.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    CLASSES[common.unwrap_or(hash as usize % CLASSES.len())].0
}

/// Black or white, whichever has the higher contrast (relative luminance of WCAG 2, with a gamma of 2.2).
pub fn ink_on(colour: Colour) -> Colour {
    let [red, green, blue] = colour.map(|sample| (f32::from(sample) / 255.0).powf(2.2));
    // At this luminance, both contrasts are equal: (1 + 0.05) / (L + 0.05) = (L + 0.05) / 0.05.
    if 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.179 { [0; 3] } else { WHITE }
}
