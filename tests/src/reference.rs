//! EEPROM images and frames as the document's tables give them, byte by byte and without a line of the
//! firmware's code: what both ends have in common cannot be wrong here too.

/// The bytes of pages 0x00 to 0x03.
pub const IMAGE_LEN: usize = 0x400;
/// The first board's key from the Pi.
pub const KEY_PI: u8 = 0x96;
/// The first board's key from the STM.
pub const KEY_STM: u8 = 0x5A;

/// An original EEPROM of the first board: pages 0x00 to 0x02 (document, chapter 6), the rest erased.
pub fn original_image() -> Vec<u8> {
    let mut image = vec![0xFF; IMAGE_LEN];
    let mut put = |address: usize, bytes: &[u8]| {
        image[address..address + bytes.len()].copy_from_slice(bytes);
    };
    // 6.0.1: the EEPROM key, both SPI keys, mode 0.
    put(
        0x0000,
        &[0x15, 0x26, 0x37, 0x48, 0x59, 0x6A, 0x7B, 0x8C, 0x9D, 0xAE],
    );
    put(0x000A, &[KEY_PI, KEY_STM, 0x00]);
    // 6.0.2: P, I, D and anti wind-up, forward and rotation.
    let forward = [6.5088, 0.073_412, 106.72, 0.3];
    let rotation = [1.3686, 0.009_326_3, 50.209, 1.4_f64];
    let gains = forward.into_iter().chain(rotation);
    for (n, gain) in gains.enumerate() {
        put(0x0100 + 8 * n, &gain.to_le_bytes());
    }
    // 6.0.3: two cells, 3.3 V at word 4095, dividers 10k/33k and 33k/22k.
    put(0x0203, &[2]);
    put(0x0204, &3.3_f64.to_le_bytes());
    put(0x020C, &4095_u32.to_le_bytes());
    for (n, ohm) in [10_000_u32, 33_000, 33_000, 22_000].into_iter().enumerate() {
        put(0x0210 + 4 * n, &ohm.to_le_bytes());
    }
    image
}

/// The original image in another mode.
pub fn image_in_mode(mode: u8) -> Vec<u8> {
    let mut image = original_image();
    image[0x000C] = mode;
    image
}

/// A Normal frame of the Pi (document, 5.2.1): key, expected pose, battery, three dummies.
pub fn normal_frame(x_um: i32, y_um: i32, rotation: u16, apply: bool) -> [u8; 19] {
    let mut frame = [0; 19];
    frame[0] = KEY_PI;
    frame[1..5].copy_from_slice(&x_um.to_be_bytes());
    frame[5..9].copy_from_slice(&y_um.to_be_bytes());
    frame[9] = u8::from(apply) << 7 | (rotation >> 8) as u8 & 0x7F;
    frame[10] = (rotation & 0xFF) as u8;
    frame
}

/// The codes of x and y, millimetres, and of a heading, degrees.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
pub fn pose_codes(x_mm: f64, y_mm: f64, degrees: f64) -> (i32, i32, u16) {
    let rotation = (degrees / 360.0 * 32768.0).round().rem_euclid(32768.0);
    (
        (x_mm * 1000.0) as i32,
        (y_mm * 1000.0) as i32,
        rotation as u16,
    )
}

/// A Guarded Normal frame of the Pi that acknowledges none: key, sequence, status, inner frame, CRC.
pub fn guarded_frame(own: u8, order: u8, inner: &[u8; 19]) -> [u8; 26] {
    let mut frame = [0; 26];
    frame[..6].copy_from_slice(&[KEY_PI, own, 0, 0, 0, order]);
    frame[6..24].copy_from_slice(&inner[1..]);
    let crc = crc16(&frame[..24]);
    frame[24..].copy_from_slice(&crc.to_be_bytes());
    frame
}

/// A tuning frame of the Pi (document, 5.2.2 and 5.2.3): key, percent, battery.
pub fn tuning_frame(percent: f64) -> [u8; 11] {
    let mut frame = [0; 11];
    frame[0] = KEY_PI;
    frame[1..9].copy_from_slice(&percent.to_le_bytes());
    frame
}

/// The STM's Normal frame, taken apart by the document's table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NormalReply {
    /// Byte 1.
    pub key: u8,
    /// Micrometres.
    pub x: i32,
    /// Micrometres.
    pub y: i32,
    /// Bit 8 of byte 9 of the position strategy.
    pub not_used: bool,
    /// Turn × 0x8000.
    pub rotation: u16,
    /// 0 = the first cell.
    pub cell: u8,
    /// Volts × 200.
    pub voltage: u16,
    /// Front, right, left.
    pub ranges: [u16; 3],
}

impl NormalReply {
    /// Takes a frame of 19 bytes apart.
    pub fn of(frame: &[u8]) -> Self {
        assert_eq!(frame.len(), 19);
        let four = |at: usize| {
            i32::from_be_bytes([frame[at], frame[at + 1], frame[at + 2], frame[at + 3]])
        };
        let two = |at: usize| u16::from_be_bytes([frame[at], frame[at + 1]]);
        Self {
            key: frame[0],
            x: four(1),
            y: four(5),
            not_used: frame[9] & 0x80 != 0,
            rotation: two(9) & 0x7FFF,
            cell: frame[11] >> 5,
            voltage: two(11) & 0x1FFF,
            ranges: [two(13), two(15), two(17)],
        }
    }
}

/// CRC-16/IBM-3740, bit by bit: initial 0xFFFF, polynomial 0x1021.
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc: u16, _| {
            let shifted = crc << 1;
            if crc & 0x8000 != 0 {
                shifted ^ 0x1021
            } else {
                shifted
            }
        })
    })
}
