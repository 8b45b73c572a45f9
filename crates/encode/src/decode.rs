//! Codes into light, as the GPU does it: the twin of `shaders/lightkiln.*`, statement by statement.
//!
//! Schaefer 2012, section 4.3: the vertex stage splits each code into a color `C`, a place `UV` and a share
//! `eta` (1 at texture-vertices, 0 at color-vertices); all three are interpolated; the fragment stage shows
//! `C + eta * tex(UV / eta)`. The paper's text has eta the other way round, its code has it this way.
//!
//! The arithmetic is `f32`, as on a GPU. Two things differ between GPUs and are exact here: the weights of
//! the bilinear filter (many GPUs round them to 1/256, so light may be off by 1/512 of the contrast of two
//! texels per axis) and the interpolation over a pixel's position. The filter reads level 0.
//!
//! Everything up to there is in unit values, those that are stored. What a viewer shows is in the signal's own
//! unit; [`unscale`] goes there.

use crate::constants::{COLOR_FLAG, COLOR_STEPS, CURVE_BASE, CURVE_KNEE, ETA_EPSILON, SUBTEXELS};
use crate::{EncodeError, LightCode, Table};

/// The numbers of one page as they are stored. Integers stand for `0..=1`, floats for themselves.
#[derive(Clone, Copy, Debug)]
pub enum Texels<'a> {
    /// 8 bits: `255` is 1.
    U8(&'a [u8]),
    /// 16 bits: `65535` is 1.
    U16(&'a [u16]),
    /// As they are.
    F32(&'a [f32]),
}

impl<'a> Texels<'a> {
    /// How many numbers there are.
    pub fn len(&self) -> usize {
        match self {
            Texels::U8(numbers) => numbers.len(),
            Texels::U16(numbers) => numbers.len(),
            Texels::F32(numbers) => numbers.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn slice(self, from: usize, to: usize) -> Texels<'a> {
        match self {
            Texels::U8(numbers) => Texels::U8(&numbers[from..to]),
            Texels::U16(numbers) => Texels::U16(&numbers[from..to]),
            Texels::F32(numbers) => Texels::F32(&numbers[from..to]),
        }
    }

    #[inline]
    fn get(&self, index: usize) -> f32 {
        match self {
            Texels::U8(numbers) => f32::from(numbers[index]) / 255.0,
            Texels::U16(numbers) => f32::from(numbers[index]) / 65535.0,
            Texels::F32(numbers) => numbers[index],
        }
    }
}

/// An atlas as it is stored: pages of equal size, row-major from `v = 0`, channels side by side.
#[derive(Clone, Debug)]
pub struct AtlasView<'a> {
    width: u32,
    page_height: u32,
    channels: u32,
    pages: Vec<Texels<'a>>,
}

impl<'a> AtlasView<'a> {
    /// An atlas of separate pages. `size` is the width and height of one page, in texels. No page at all is
    /// an atlas too: every lookup gives 0.
    ///
    /// # Errors
    /// [`EncodeError::AtlasPage`] when a page does not hold width × height × channels numbers.
    pub fn new(size: [u32; 2], channels: u32, pages: Vec<Texels<'a>>) -> Result<Self, EncodeError> {
        let [width, page_height] = size;
        let expected = width as usize * page_height as usize * channels as usize;
        if let Some(page) = pages.iter().position(|page| page.len() != expected || expected == 0) {
            let count = pages[page].len();
            return Err(EncodeError::AtlasPage { page, count, width, page_height, channels, expected });
        }
        Ok(Self { width, page_height, channels, pages })
    }

    /// An atlas whose pages stand one under the other in one image, as in the atlas file.
    ///
    /// # Errors
    /// [`EncodeError::AtlasPage`] when the image does not hold `pages` whole pages.
    pub fn stacked(
        size: [u32; 2],
        pages: u32,
        channels: u32,
        texels: Texels<'a>,
    ) -> Result<Self, EncodeError> {
        let page = size[0] as usize * size[1] as usize * channels as usize;
        if texels.len() != page * pages as usize {
            let (count, expected) = (texels.len(), page * pages as usize);
            let [width, page_height] = size;
            return Err(EncodeError::AtlasPage { page: 0, count, width, page_height, channels, expected });
        }
        Self::new(
            size,
            channels,
            (0..pages as usize).map(|p| texels.slice(p * page, (p + 1) * page)).collect(),
        )
    }

    /// Width and height of one page, in texels.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.page_height]
    }

    /// How many pages there are.
    pub fn pages(&self) -> u32 {
        self.pages.len() as u32
    }

    /// Numbers per texel.
    pub fn channels(&self) -> u32 {
        self.channels
    }

    /// `tex`: the bilinear value of a channel at a place of the stack, in texels.
    ///
    /// The page is `floor(v / page_height)`, clamped to the pages that there are; the four texels are clamped
    /// to that page. 0 without a page, for a channel that does not exist and for NaN.
    #[inline]
    pub fn lookup(&self, position: [f32; 2], channel: u32) -> f32 {
        match self.footprint(position) {
            Some(footprint) if channel < self.channels => footprint.mix(channel as usize),
            _ => 0.0,
        }
    }

    /// As [`AtlasView::lookup`], of as many channels as `out` has room for.
    #[inline]
    pub fn read(&self, position: [f32; 2], out: &mut [f32]) {
        let footprint = self.footprint(position);
        for (channel, out) in out.iter_mut().enumerate() {
            *out = match &footprint {
                Some(footprint) if channel < self.channels as usize => footprint.mix(channel),
                _ => 0.0,
            };
        }
    }

    #[inline]
    fn footprint(&self, [u, v]: [f32; 2]) -> Option<Footprint<'a>> {
        if self.pages.is_empty() || !(u + v).is_finite() {
            return None;
        }
        let page_height = self.page_height as f32;
        let page = (v / page_height).floor().clamp(0.0, self.pages.len() as f32 - 1.0);
        // The sampler: texel centres lie at half-integers.
        let (x, y) = (u - 0.5, v - page * page_height - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let column = |x: f32| x.clamp(0.0, self.width as f32 - 1.0) as usize;
        let row = |y: f32| y.clamp(0.0, page_height - 1.0) as usize;
        let at = |x: f32, y: f32| (row(y) * self.width as usize + column(x)) * self.channels as usize;
        Some(Footprint {
            texels: self.pages[page as usize],
            from: [at(left, top), at(left + 1.0, top), at(left, top + 1.0), at(left + 1.0, top + 1.0)],
            right_share: x - left,
            bottom_share: y - top,
        })
    }
}

/// The four texels of a lookup.
struct Footprint<'a> {
    texels: Texels<'a>,
    /// Where each begins in its page: the upper two, the lower two.
    from: [usize; 4],
    right_share: f32,
    bottom_share: f32,
}

impl Footprint<'_> {
    #[inline]
    fn mix(&self, channel: usize) -> f32 {
        let [a, b, c, d] = self.from.map(|from| self.texels.get(from + channel));
        let mix = |a: f32, b: f32, share: f32| a * (1.0 - share) + b * share;
        mix(mix(a, b, self.right_share), mix(c, d, self.right_share), self.bottom_share)
    }
}

/// What the colors of a layer's codes are.
#[derive(Clone, Copy, Debug)]
pub enum Form<'a> {
    /// One value, packed.
    Scalar,
    /// Three values (or two, and 0), packed.
    Rgb,
    /// The number of an entry.
    Table(&'a Table),
}

impl Form<'_> {
    /// The packed form of a layer: scalar for one channel, RGB for more.
    pub fn packed(channels: usize) -> Self {
        if channels == 1 { Form::Scalar } else { Form::Rgb }
    }

    /// The color of a code, channels that the form does not have as 0; `None` for a texture-vertex.
    #[inline]
    pub fn color(&self, code: LightCode) -> Option<[f32; 3]> {
        match self {
            Form::Scalar => code.value().map(|value| [value, 0.0, 0.0]),
            Form::Rgb => code.rgb(),
            Form::Table(table) => code.index().map(|index| table.color(index)),
        }
    }
}

/// What the vertex stage hands on: C, UV and eta; `N` is 1 for scalar layers and 3 for others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Varyings<const N: usize> {
    /// `C`: the color of a color-vertex, else 0.
    pub color: [f32; N],
    /// `UV`: the place of a texture-vertex in the stack of pages, in texels, else 0.
    pub position: [f32; 2],
    /// 1 at a texture-vertex, 0 at a color-vertex.
    pub eta: f32,
}

/// The vertex stage of a scalar layer.
#[inline]
pub fn vertex_scalar(code: LightCode) -> Varyings<1> {
    let [x, y] = code.0.map(f32::from);
    if y >= f32::from(COLOR_FLAG) {
        Varyings { color: [x / f32::from(COLOR_STEPS)], position: [0.0, 0.0], eta: 0.0 }
    } else {
        Varyings { color: [0.0], position: [x / SUBTEXELS as f32, y / SUBTEXELS as f32], eta: 1.0 }
    }
}

/// The vertex stage of a layer in any form.
#[inline]
pub fn vertex(code: LightCode, form: &Form<'_>) -> Varyings<3> {
    match form.color(code) {
        Some(color) => Varyings { color, position: [0.0, 0.0], eta: 0.0 },
        None => Varyings { color: [0.0; 3], position: code.position().unwrap_or_default(), eta: 1.0 },
    }
}

/// What the rasterizer does: the weighted sum of three corners.
#[inline]
pub fn interpolate<const N: usize>(corners: [Varyings<N>; 3], weights: [f32; 3]) -> Varyings<N> {
    let [a, b, c] = &corners;
    let sum = |a: f32, b: f32, c: f32| a * weights[0] + b * weights[1] + c * weights[2];
    Varyings {
        color: std::array::from_fn(|i| sum(a.color[i], b.color[i], c.color[i])),
        position: std::array::from_fn(|i| sum(a.position[i], b.position[i], c.position[i])),
        eta: sum(a.eta, b.eta, c.eta),
    }
}

/// The fragment stage.
#[inline]
pub fn fragment<const N: usize>(at: Varyings<N>, atlas: &AtlasView<'_>) -> [f32; N] {
    let mut light = at.color;
    if at.eta > ETA_EPSILON {
        let mut texel = [0.0; N];
        atlas.read([at.position[0] / at.eta, at.position[1] / at.eta], &mut texel);
        for (light, texel) in light.iter_mut().zip(texel) {
            *light += at.eta * texel;
        }
    }
    light
}

/// The light that the GPU shows at a point of a triangle, before the curve is undone ([`unscale`]).
///
/// - `codes`: of the three corners
/// - `barycentric`: weights of the second and third corner, as in `SurfacePoint`
/// - `out`: a value per channel of the layer, unit values; a fourth channel and more is 0
#[inline]
pub fn decode(
    codes: [LightCode; 3],
    barycentric: [f32; 2],
    atlas: &AtlasView<'_>,
    form: &Form<'_>,
    out: &mut [f32],
) {
    if let (Form::Scalar, [value]) = (form, &mut *out) {
        *value = decode_scalar(codes, barycentric, atlas);
        return;
    }
    let [second, third] = barycentric;
    let corners = codes.map(|code| vertex(code, form));
    let light = fragment(interpolate(corners, [1.0 - second - third, second, third]), atlas);
    for (channel, out) in out.iter_mut().enumerate() {
        *out = light.get(channel).copied().unwrap_or(0.0);
    }
}

/// As [`decode()`], of a scalar layer in packed form.
#[inline]
pub fn decode_scalar(codes: [LightCode; 3], [second, third]: [f32; 2], atlas: &AtlasView<'_>) -> f32 {
    let corners = codes.map(vertex_scalar);
    fragment(interpolate(corners, [1.0 - second - third, second, third]), atlas)[0]
}

/// What a material is told of a layer's scale: the uniform `scale` of the shaders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaderScale {
    /// `P(low)`: the curve's value at a stored 0.
    pub low: f32,
    /// `P(high) - P(low)`.
    pub extent: f32,
    /// The signal's value that is white; 0 for the linear curve.
    pub white: f32,
}

/// The signal's value of a stored one, in the signal's unit: the twin of `lightkilnLightUnscale`.
///
/// To be done after all interpolation, per channel.
#[inline]
pub fn unscale(unit: f32, scale: ShaderScale) -> f32 {
    let p = scale.low + unit * scale.extent;
    if scale.white > 0.0 {
        p.signum() * (CURVE_BASE.powf(p.abs()) - 1.0) * (scale.white / CURVE_KNEE)
    } else {
        p
    }
}

/// Clamp after interpolation, of layers that ask for it (Kavan et al. 2011, section 3.3): the twin of `lightkilnLightClamp`.
///
/// `ends` are in the unit of `light`, the lower one first; shaders clamp what [`unscale`] gives, which is the same for
/// stored values, the curve being monotonic. NaN stays.
#[inline]
pub fn clamp(light: f32, [low, high]: [f32; 2]) -> f32 {
    if light < low {
        low
    } else if light > high {
        high
    } else {
        light
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lightkiln_light::scale::{Curve, KNEE, Scale};

    fn place(u: f32, v: f32) -> LightCode {
        LightCode::texture([u, v]).expect("in range")
    }

    #[test]
    fn decode_three_colors_interpolates() {
        let none = AtlasView::new([0, 0], 1, vec![]).expect("empty");
        let codes = [0.0, 0.5, 1.0].map(LightCode::color);
        assert!((decode_scalar(codes, [0.25, 0.5], &none) - 0.625).abs() < 1e-5);
        // Without an atlas, texture-vertices are black and nothing panics.
        assert_eq!(decode_scalar([place(1.0, 1.0); 3], [0.3, 0.3], &none), 0.0);
    }

    #[test]
    fn decode_three_texture_vertices_reads_the_atlas() {
        let texels = [0, 51, 102, 153];
        let atlas = AtlasView::stacked([2, 2], 1, 1, Texels::U8(&texels)).expect("fits");
        let codes = [place(0.5, 0.5), place(1.5, 0.5), place(0.5, 1.5)];
        let close = |x: f32, y: f32| assert!((x - y).abs() < 1e-6, "{x} {y}");
        close(decode_scalar(codes, [0.0, 0.0], &atlas), 0.0);
        close(decode_scalar(codes, [1.0, 0.0], &atlas), 0.2);
        close(decode_scalar(codes, [0.0, 1.0], &atlas), 0.4);
        close(decode_scalar(codes, [0.5, 0.5], &atlas), 0.3);
        close(decode_scalar(codes, [0.5, 0.25], &atlas), 0.2);
    }

    #[test]
    fn decode_eta_is_one_at_texture_vertices() {
        // Section 4.3, two texture-vertices and a color: tex along their edge, blended with the color.
        let texels = [0.0, 1.0, 0.0, 1.0];
        let atlas = AtlasView::stacked([2, 2], 1, 1, Texels::F32(&texels)).expect("fits");
        let codes = [place(0.5, 1.0), place(1.5, 1.0), LightCode::color(1.0)];
        for (a, b, c) in [(0.2_f32, 0.3_f32, 0.5_f32), (0.6, 0.4, 0.0), (0.0, 0.01, 0.99), (0.0, 0.0, 1.0)] {
            let on_edge = if a + b > 0.0 { b / (a + b) } else { 0.0 };
            let expected = (a + b) * on_edge + c;
            let shown = decode_scalar(codes, [b, c], &atlas);
            assert!((shown - expected).abs() < 2e-5, "{shown} {expected}");
        }
    }

    #[test]
    fn decode_undoes_the_scale_of_the_light() {
        for (curve, white) in [(Curve::Log { white: 500.0 }, 500.0), (Curve::Linear, 0.0)] {
            for (low, high) in [(0.0, 2000.0), (-8000.0, 8000.0), (3.0, 4.0)] {
                let scale = Scale { curve, low, high };
                let [from, to] = [low, high].map(|x| scale.perceived(x));
                let uniform = ShaderScale { low: from, extent: to - from, white };
                for unit in [-0.1, 0.0, 0.25, 0.5, 0.999, 1.0, 1.2] {
                    let (shown, expected) = (unscale(unit, uniform), scale.from_unit(unit));
                    assert!((shown - expected).abs() < 1e-4 * (1.0 + expected.abs()), "{shown} {expected}");
                }
            }
        }
        assert_eq!((CURVE_KNEE, CURVE_BASE), (KNEE, 1.0 + KNEE));
    }

    #[test]
    fn decode_tiny_eta_is_color() {
        let atlas = AtlasView::stacked([1, 1], 1, 1, Texels::U8(&[255])).expect("fits");
        let at =
            |eta: f32| fragment(Varyings { color: [0.25], position: [0.5 * eta, 0.5 * eta], eta }, &atlas)[0];
        for eta in [-1e-3, -0.0, 0.0, 1e-30, ETA_EPSILON, f32::NAN] {
            assert_eq!(at(eta), 0.25);
        }
        // No visible step where the lookup sets in.
        assert!(at(ETA_EPSILON * 1.01) - 0.25 < 0.5 / 32767.0 * 1.02);
    }

    #[test]
    fn lookup_is_clamped_to_its_page() {
        // Two pages of 2 x 2: all 0, all 1.
        let texels = [0, 0, 0, 0, 65535, 65535, 65535, 65535];
        let atlas = AtlasView::stacked([2, 2], 2, 1, Texels::U16(&texels)).expect("fits");
        for (v, expected) in [(0.0, 0.0), (1.999, 0.0), (2.0, 1.0), (3.999, 1.0), (9.0, 1.0), (-5.0, 0.0)] {
            assert_eq!(atlas.lookup([1.0, v], 0), expected, "v = {v}");
        }
        for u in [-1e9, -0.5, 0.0, 2.0, 2.5, 1e9] {
            assert_eq!(atlas.lookup([u, 3.0], 0), 1.0);
        }
        assert_eq!(atlas.lookup([f32::NAN, 1.0], 0), 0.0);
        assert_eq!(atlas.lookup([1.0, f32::INFINITY], 0), 0.0);
        assert_eq!(atlas.lookup([1.0, 1.0], 1), 0.0);
    }

    #[test]
    fn lookup_channels_lie_side_by_side() {
        let texels = [0.1, 0.2, 0.3, 0.7, 0.8, 0.9];
        let atlas = AtlasView::stacked([2, 1], 1, 3, Texels::F32(&texels)).expect("fits");
        assert!((atlas.lookup([1.0, 0.5], 1) - 0.5).abs() < 1e-6);
        assert_eq!((atlas.size(), atlas.pages(), atlas.channels()), ([2, 1], 1, 3));
    }

    #[test]
    fn atlas_wrong_length_is_refused() {
        let error = AtlasView::stacked([2, 2], 2, 1, Texels::U8(&[0; 7])).expect_err("7 of 8");
        assert!(matches!(error, EncodeError::AtlasPage { count: 7, expected: 8, .. }), "{error}");
        let pages = vec![Texels::U8(&[0; 4]), Texels::U8(&[0; 3])];
        let error = AtlasView::new([2, 2], 1, pages).expect_err("3 of 4");
        assert!(matches!(error, EncodeError::AtlasPage { page: 1, count: 3, expected: 4, .. }), "{error}");
    }
}
