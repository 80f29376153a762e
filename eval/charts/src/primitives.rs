//! Positions, areas and colours of shapes.

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Position in px from the left and the top.
pub type Position = (f32, f32);

/// Rectangle in px: left, top, right, bottom.
pub type Area = (f32, f32, f32, f32);

pub const INK: Colour = [0x22, 0x22, 0x22];
pub const GREY: Colour = [0x55, 0x55, 0x55];
pub const FADED: Colour = [0xbd, 0xbd, 0xbd];
pub const FAINT: Colour = [0xe4, 0xe4, 0xe4];
pub const WHITE: Colour = [0xff; 3];

/// Half the size of a marker, px.
pub const RADIUS: f32 = 6.0;

/// The palette of Okabe and Ito, which colour-blind readers can distinguish, without its yellow, which is faint on white.
pub const COLOURS: [Colour; 7] = [
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x9e, 0x73],
    [0xcc, 0x79, 0xa7],
    [0x00, 0x00, 0x00],
    [0xe6, 0x9f, 0x00],
    [0x56, 0xb4, 0xe9],
];
