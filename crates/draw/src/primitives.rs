//! Positions, areas and colours.

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Position in px from the left and the top.
pub type Position = (f32, f32);

/// Rectangle in px: left, top, right, bottom.
pub type Area = (f32, f32, f32, f32);

pub const INK: Colour = [0x22, 0x22, 0x22];
pub const GREY: Colour = [0x55, 0x55, 0x55];
pub const FAINT: Colour = [0xe4, 0xe4, 0xe4];
pub const WHITE: Colour = [0xff; 3];

/// Half the size of a marker, px.
pub const RADIUS: f32 = 6.0;

/// Colour of the labels of faded points, which are read on white.
pub const FADED_TEXT: Colour = [0x76, 0x76, 0x76];

/// The colours with the names of common classes. Each colour is visible on dark and on bright images.
const CLASS_COLOURS: [(Colour, &[&str]); 12] = [
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
    let common = CLASS_COLOURS.iter().position(|(_, names)| known(names));
    CLASS_COLOURS[common.unwrap_or_else(|| hash(name) % CLASS_COLOURS.len())].0
}

/// The hash FNV-1a.
pub fn hash(name: &str) -> usize {
    name.bytes().fold(0x811c_9dc5_u32, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
        as usize
}

/// Black or white, whichever has the higher contrast (relative luminance of WCAG 2, with a gamma of 2.2).
pub fn ink_on(colour: Colour) -> Colour {
    let [red, green, blue] = colour.map(|sample| (f32::from(sample) / 255.0).powf(2.2));
    // At this luminance, both contrasts are equal: (1 + 0.05) / (L + 0.05) = (L + 0.05) / 0.05.
    if 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.179 { [0; 3] } else { WHITE }
}
