//! Frames whose every byte follows from the first: what the bring-up firmware and `robot bringup` exchange
//! to test the wire.

use super::MAX_FRAME;

/// The byte at `place` of the frame that begins with `first`.
fn byte(first: u8, place: u8) -> u8 {
    (first ^ place.wrapping_mul(0x35)).rotate_left(u32::from(place & 7))
}

/// Writes the frame of `number`, of which the low byte counts; returns its length, bytes.
#[allow(clippy::cast_possible_truncation, reason = "the low byte is meant")]
pub fn encode(number: u32, out: &mut [u8; MAX_FRAME]) -> usize {
    for (place, slot) in (0_u8..).zip(out.iter_mut()) {
        *slot = byte(number as u8, place);
    }
    MAX_FRAME
}

/// Whether a frame has the length and the bytes that its first byte demands.
pub fn is_whole(frame: &[u8]) -> bool {
    let Some(&first) = frame.first() else {
        return false;
    };
    let mut places = (0_u8..).zip(frame);
    frame.len() == MAX_FRAME && places.all(|(place, &found)| found == byte(first, place))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn test_frame_any_change_is_noticed() {
        for number in 0..=u8::MAX {
            let mut frame = [0; MAX_FRAME];
            assert_eq!(encode(number.into(), &mut frame), MAX_FRAME);
            assert!(is_whole(&frame) && frame[0] == number);
            assert!(!is_whole(&frame[..MAX_FRAME - 1]) && !is_whole(&[]));
            for bit in 0..8 * MAX_FRAME {
                frame[bit / 8] ^= 1 << (bit % 8);
                assert!(!is_whole(&frame), "bit {bit} of frame {number}");
                frame[bit / 8] ^= 1 << (bit % 8);
            }
            // A byte that is sent twice shifts the rest.
            frame.copy_within(0..MAX_FRAME - 1, 1);
            assert!(!is_whole(&frame));
        }
    }
}
