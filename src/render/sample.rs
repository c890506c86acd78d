//! A sample of a picture: the surface that is seen there, not yet lit.

/// Bytes of one sample.
pub(super) const SAMPLE_BYTES: usize = std::mem::size_of::<Sample>();

/// Surface that is seen at one sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// 1 / distance from the eye; 0 where nothing is seen.
    pub(super) nearness: f32,
    /// Sum of normals, towards the viewer, in camera space.
    pub(super) normal: [f32; 3],
    /// Sum of colours times weight; as `material` says.
    pub(super) color: [f32; 3],
    /// Sum of weights.
    pub(super) weight: f32,
    /// Meaning of `color`: `PLAIN`, `LIGHT`, or the number of a material with an image, where it is two texture
    /// coordinates and the texels from here to the next sample.
    pub(super) material: u32,
    /// Cover by edge lines, of 255.
    pub(super) ink: u8,
    /// `BACK`, `UNLIT`, `MIRRORED`, `WITHIN`.
    pub(super) flags: u8,
    /// Direction of rising u around the normal, for normal maps; `turn` counts it.
    pub(super) turn: u16,
}

impl Sample {
    /// Colours are sRGB values in [0, 1].
    pub(super) const PLAIN: u32 = u32::MAX;
    /// Colours are linear light.
    pub(super) const LIGHT: u32 = u32::MAX - 1;
    /// The back of the surface is seen.
    pub(super) const BACK: u8 = 1;
    /// Light does not matter.
    pub(super) const UNLIT: u8 = 2;
    /// The image is mirrored on the surface, as its front side has it.
    pub(super) const MIRRORED: u8 = 4;
    /// The triangle lies within one repetition of its images, along each coordinate.
    pub(super) const WITHIN: [u8; 2] = [8, 16];
    /// Flags of a place in an image.
    const OF_PLACE: u8 = Sample::MIRRORED | Sample::WITHIN[0] | Sample::WITHIN[1];
    /// Nothing.
    pub(super) const NONE: Sample = Sample {
        nearness: 0.0,
        normal: [0.0; 3],
        color: [0.0; 3],
        weight: 0.0,
        material: Sample::PLAIN,
        ink: 0,
        flags: 0,
        turn: 0,
    };

    /// True if `color` is a place in an image.
    pub(super) fn is_on_image(&self) -> bool {
        self.material < Sample::LIGHT
    }

    /// Adds what a small triangle shows: in front it replaces, at the same depth it is averaged in. Returns whether it is the
    /// front one.
    pub(super) fn average(&mut self, found: &Sample, tolerance: f32) -> bool {
        let is_front = found.nearness > self.nearness;
        if found.nearness > self.nearness * (1.0 + tolerance) {
            *self = *found;
        } else if found.nearness >= self.nearness * (1.0 - tolerance) {
            for i in 0..3 {
                self.normal[i] += found.normal[i];
            }
            let sum = self.weight + found.weight;
            if self.is_on_image() || found.is_on_image() {
                // Places in images have no mean: the front one stands for all, and a smaller size of the image.
                let front = if is_front { *found } else { *self };
                let share = if front.is_on_image() { 1.0 } else { sum / front.weight.max(1e-20) };
                (self.color, self.material) = (front.color.map(|x| share * x), front.material);
                self.turn = front.turn;
                let side = (self.flags & !Sample::OF_PLACE) | (front.flags & Sample::OF_PLACE);
                self.flags = side & (found.flags | Sample::OF_PLACE);
            } else {
                (0..3).for_each(|i| self.color[i] += found.color[i]);
                self.flags &= found.flags;
            }
            self.weight = sum;
            self.nearness = self.nearness.max(found.nearness);
        }
        is_front
    }
}
