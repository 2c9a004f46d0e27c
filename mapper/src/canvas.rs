//! A picture of coloured pixels: smooth lines, small capitals, PNG.

/// Red, green, blue.
pub(crate) type Colour = [u8; 3];

pub(crate) struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl Canvas {
    pub(crate) fn new(width: usize, height: usize, colour: Colour) -> Self {
        Self {
            width,
            height,
            pixels: colour.repeat(width * height),
        }
    }

    pub(crate) fn fill(&mut self, x: usize, y: usize, width: usize, height: usize, colour: Colour) {
        for row in y..(y + height).min(self.height) {
            for column in x..(x + width).min(self.width) {
                let at = 3 * (row * self.width + column);
                self.pixels[at..at + 3].copy_from_slice(&colour);
            }
        }
    }

    /// A line of this width in pixels with round ends, its edges smoothed.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )]
    pub(crate) fn line(&mut self, from: (f64, f64), to: (f64, f64), width: f64, colour: Colour) {
        let line = crate::Segment::new(from.0, from.1, to.0, to.1);
        let reach = width / 2.0 + 1.0;
        let low = |a: f64, b: f64| (a.min(b) - reach).max(0.0) as usize;
        let high =
            |a: f64, b: f64, limit: usize| ((a.max(b) + reach + 1.0).max(0.0) as usize).min(limit);
        for row in low(from.1, to.1)..high(from.1, to.1, self.height) {
            for column in low(from.0, to.0)..high(from.0, to.0, self.width) {
                let distance = line.distance(column as f64 + 0.5, row as f64 + 0.5);
                let cover = (width / 2.0 + 0.5 - distance).clamp(0.0, 1.0);
                let at = 3 * (row * self.width + column);
                for (pixel, ink) in self.pixels[at..at + 3].iter_mut().zip(colour) {
                    *pixel = (f64::from(*pixel) * (1.0 - cover) + f64::from(ink) * cover) as u8;
                }
            }
        }
    }

    /// Capitals, digits, space, point and hyphen; every dot of their 3 by 5 is `size` pixels wide.
    /// Returns the width used.
    pub(crate) fn text(
        &mut self,
        x: usize,
        y: usize,
        size: usize,
        text: &str,
        colour: Colour,
    ) -> usize {
        for (index, letter) in text.chars().enumerate() {
            let dots = glyph(letter);
            for dot in 0..15 {
                if dots >> (14 - dot) & 1 == 1 {
                    let left = x + (4 * index + dot % 3) * size;
                    self.fill(left, y + dot / 3 * size, size, size, colour);
                }
            }
        }
        4 * size * text.len()
    }

    /// The picture as a PNG file.
    pub(crate) fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut file = Vec::new();
        let size = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
        let mut encoder = png::Encoder::new(&mut file, size(self.width), size(self.height));
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.pixels)?;
        writer.finish()?;
        Ok(file)
    }
}

/// Rows of three dots from the top, one octal digit each; what is not here is blank.
const fn glyph(letter: char) -> u16 {
    match letter {
        'A' => 0o25755,
        'B' => 0o65656,
        'C' => 0o34443,
        'D' => 0o65556,
        'E' => 0o74647,
        'F' => 0o74644,
        'G' => 0o34553,
        'H' => 0o55755,
        'I' => 0o72227,
        'J' => 0o11152,
        'K' => 0o55655,
        'L' => 0o44447,
        'M' => 0o57755,
        'N' => 0o65555,
        'O' => 0o25552,
        'P' => 0o65644,
        'Q' => 0o25563,
        'R' => 0o65655,
        'S' => 0o34216,
        'T' => 0o72222,
        'U' => 0o55557,
        'V' => 0o55552,
        'W' => 0o55775,
        'X' => 0o55255,
        'Y' => 0o55222,
        'Z' => 0o71247,
        '0' => 0o75557,
        '1' => 0o26227,
        '2' => 0o61247,
        '3' => 0o61216,
        '4' => 0o55711,
        '5' => 0o74616,
        '6' => 0o34757,
        '7' => 0o71222,
        '8' => 0o75757,
        '9' => 0o75716,
        '.' => 0o00002,
        '-' => 0o00700,
        _ => 0,
    }
}
