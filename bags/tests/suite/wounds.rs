//! Damage to the bytes of a good file, the same on every run: for tests that compare what a reader makes of a damaged file with
//! what it makes of the whole one.

/// A damaged copy of a file.
pub struct Wounded {
    /// The description of the damage, for the message of a test that fails.
    pub how: String,
    /// The bytes after it; they always differ from those before.
    pub bytes: Vec<u8>,
}

/// Returns damage number `number` to `whole`: a bit that is flipped, bytes that are overwritten, bytes that are zero, or the end cut
/// off.
pub fn wounded(whole: &[u8], number: u64) -> Wounded {
    assert!(whole.len() > 1, "there is something to damage");
    // A damage may change nothing, such as zeros where there are zeros already; then the next one is taken.
    (0..).map(|round| attempt(whole, number, round)).find(|wound| wound.bytes != whole).expect("without end")
}

fn attempt(whole: &[u8], number: u64, round: u64) -> Wounded {
    let mut state = number.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ round;
    let mut bytes = whole.to_vec();
    let at = below(&mut state, whole.len());
    let end = (at + 1 + below(&mut state, 48)).min(whole.len());
    let how = match number % 4 {
        0 => {
            let bit = below(&mut state, 8);
            bytes[at] ^= 1 << bit;
            format!("bit {bit} of byte {at} flipped")
        }
        1 => {
            bytes[at..end].iter_mut().for_each(|byte| *byte = below(&mut state, 256) as u8);
            format!("bytes {at}..{end} overwritten")
        }
        2 => {
            bytes[at..end].fill(0);
            format!("bytes {at}..{end} zero")
        }
        _ => {
            bytes.truncate(at);
            format!("cut at byte {at}")
        }
    };
    Wounded { how: format!("damage {number}: {how}"), bytes }
}

/// Returns a number below `end`, by SplitMix64.
fn below(state: &mut u64, end: usize) -> usize {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut mixed = *state;
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((mixed ^ (mixed >> 31)) % end as u64) as usize
}
