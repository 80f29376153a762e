//! Spike recordings that tests make for themselves: archives of numpy with the readings of pixels that reset.

/// The `.npy` file of bytes.
pub fn npy(kind: &str, order: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
    let length = u16::try_from(header.len()).expect("a short header").to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), values].concat()
}

/// A ZIP file with one file, which is stored as it is.
pub fn zip(name: &str, content: &[u8]) -> Vec<u8> {
    packed_zip(name, content, 0, content)
}

/// A ZIP file with one file, which the compression `method` has turned into `packed`.
pub fn packed_zip(name: &str, content: &[u8], method: u16, packed: &[u8]) -> Vec<u8> {
    let number = |number: usize| u32::try_from(number).expect("a small file").to_le_bytes();
    let facts = [
        // The version and the flags, then the compression, the time and the date.
        &[20, 0, 0, 0][..],
        &method.to_le_bytes(),
        &[0; 4],
        &crc(content).to_le_bytes(),
        &number(packed.len()),
        &number(content.len()),
        &number(name.len())[..2],
        &[0; 2],
    ]
    .concat();
    let file = [b"PK\x03\x04", &facts[..], name.as_bytes(), packed].concat();
    let list = [b"PK\x01\x02\x14\x00", &facts[..], &[0; 14], name.as_bytes()].concat();
    let end =
        [b"PK\x05\x06", &[0, 0, 0, 0, 1, 0, 1, 0][..], &number(list.len()), &number(file.len()), &[0; 2]]
            .concat();
    [file, list, end].concat()
}

/// CRC-32 of ISO 3309.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(
            crc ^ u32::from(*byte),
            |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 },
        )
    })
}

/// The readings of pixels that collect light and reset when they are full, T x H x W of 0 or 1. `light` is the share of a filling that the
/// pixel at (row, column) gets between two readings, in [0, 1].
pub fn readings(
    (count, height, width): (usize, usize, usize),
    light: impl Fn(usize, usize) -> f64,
) -> Vec<u8> {
    let reading = |number: usize| {
        let filled = |number: usize, row, column| (number as f64 * light(row, column)).floor();
        let pixels = (0..height).flat_map(move |row| (0..width).map(move |column| (row, column)));
        pixels
            .map(move |(row, column)| u8::from(filled(number + 1, row, column) > filled(number, row, column)))
    };
    (0..count).flat_map(|number| reading(number).collect::<Vec<_>>()).collect()
}

/// The resets of each pixel in the readings from `first` on, as many as `window`.
pub fn resets(readings: &[u8], pixels: usize, first: usize, window: usize) -> Vec<u16> {
    let of_window = readings.chunks_exact(pixels).skip(first).take(window);
    of_window.fold(vec![0; pixels], |sums, reading| {
        sums.iter().zip(reading).map(|(sum, value)| sum + u16::from(*value)).collect()
    })
}

/// A recording of these readings as numpy saves it.
pub fn recording((count, height, width): (usize, usize, usize), readings: &[u8]) -> Vec<u8> {
    zip("spk.npy", &npy("|u1", "False", &format!("({count}, {height}, {width})"), readings))
}
