//! A drawing area that becomes a PNG file, with its own font.

use std::error::Error;
use std::fmt;
use std::sync::Once;

use plotters::backend::{PixelFormat, RGBPixel};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::register_font;

/// A plot could not be drawn or encoded.
#[derive(Debug)]
pub struct PlotError(Box<dyn Error + Send + Sync>);

impl fmt::Display for PlotError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "cannot draw the plot: {}", self.0)
    }
}

impl Error for PlotError {}

impl PlotError {
    pub(crate) fn new(what: String) -> Self {
        Self(what.into())
    }
}

pub(crate) type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;
pub(crate) type Drawn = Result<(), Box<dyn Error + Send + Sync>>;

pub(crate) const PAPER: RGBColor = RGBColor(252, 252, 250);
pub(crate) const INK: RGBColor = RGBColor(40, 44, 52);
pub(crate) const FONT: &str = "Hack";
pub(crate) const TEXT_PX: i32 = 15;

static FONT_REGISTERED: Once = Once::new();

/// The PNG file of what `draw` draws on an area of this size.
pub(crate) fn png(
    width: u32,
    height: u32,
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<Vec<u8>, PlotError> {
    FONT_REGISTERED.call_once(|| {
        let font = epaint_default_fonts::HACK_REGULAR;
        let _ = register_font(FONT, FontStyle::Normal, font);
    });
    let mut pixels = vec![0; (width * height) as usize * RGBPixel::PIXEL_SIZE];
    {
        let area = BitMapBackend::with_buffer(&mut pixels, (width, height)).into_drawing_area();
        area.fill(&PAPER).map_err(|e| PlotError(e.into()))?;
        draw(&area).map_err(PlotError)?;
        area.present().map_err(|e| PlotError(e.into()))?;
    }
    encode(width, height, &pixels).map_err(|e| PlotError(e.into()))
}

fn encode(width: u32, height: u32, pixels: &[u8]) -> Result<Vec<u8>, png::EncodingError> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(file)
}

/// Draws coloured squares with their names, from `left` at the height `top`, in as many rows as the width
/// needs.
pub(crate) fn legend(area: &Area<'_>, left: i32, top: i32, entries: &[(&str, RGBColor)]) -> Drawn {
    let style = TextStyle::from((FONT, TEXT_PX)).color(&INK);
    let right = i32::try_from(area.dim_in_pixel().0)?;
    let (mut x, mut top) = (left, top);
    for (name, colour) in entries {
        let width = i32::try_from(area.estimate_text_size(name, &style)?.0)? + TEXT_PX + 7;
        if x > left && x + width > right {
            (x, top) = (left, top + TEXT_PX + 8);
        }
        let square = [(x, top), (x + TEXT_PX, top + TEXT_PX)];
        area.draw(&Rectangle::new(square, colour.filled()))?;
        area.draw(&Rectangle::new(square, INK.stroke_width(1)))?;
        let at = (x + TEXT_PX + 7, top);
        area.draw(&Text::new((*name).to_owned(), at, style.clone()))?;
        x += width + 22;
    }
    Ok(())
}

#[cfg(test)]
pub(crate) fn decode(file: &[u8]) -> (u32, u32, Vec<u8>) {
    let decoder = png::Decoder::new(std::io::Cursor::new(file));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, info.height, pixels)
}
