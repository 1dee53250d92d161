//! Colours of textures: their texels as red, green and blue.
//!
//! A glossy surface shows colours, because what it reflects is coloured. A texture of 8 bits stays so, because three
//! float32 a texel are the largest part of what a scene with large textures takes.
//!
//! What must not break: a texel has the same value however it is stored.

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::render::light::texture::Texture;

/// The texels of a texture row by row, in a frame of one texel around it.
#[derive(Clone, Debug)]
pub enum ColourImage {
    /// Red, green and blue.
    Linear(Vec<[f32; 3]>),
    /// The same as 8-bit numbers, and the value that each number stands for.
    Coded(Vec<[u8; 3]>, Box<[f32; 256]>),
}

impl ColourImage {
    fn len(&self) -> usize {
        match self {
            Self::Linear(texels) => texels.len(),
            Self::Coded(texels, _) => texels.len(),
        }
    }

    fn is_finite(&self) -> bool {
        match self {
            Self::Linear(texels) => texels.iter().flatten().all(|x| x.is_finite()),
            Self::Coded(_, values) => values.iter().all(|x| x.is_finite()),
        }
    }

    fn at(&self, at: usize) -> [f32; 3] {
        match self {
            Self::Linear(texels) => texels[at],
            Self::Coded(texels, values) => texels[at].map(|number| values[usize::from(number)]),
        }
    }
}

/// The colours of all textures of a scene; textures may share an image.
#[derive(Clone, Debug, Default)]
pub struct TextureColours {
    /// Of each texture the number of its image.
    pub of_texture: Vec<u32>,
    /// The images.
    pub images: Vec<Arc<ColourImage>>,
}

impl TextureColours {
    /// Checks that each of a scene's textures has an image of its size.
    pub(super) fn check(&self, textures: &[Texture]) -> Result<()> {
        if self.of_texture.len() != textures.len() {
            let (given, count) = (self.of_texture.len(), textures.len());
            return Err(Error::Argument(format!("colours are given of {count} textures, got {given}")));
        }
        for (number, (texture, image)) in textures.iter().zip(&self.of_texture).enumerate() {
            let texels = (texture.width as usize + 2) * (texture.height as usize + 2);
            if self.images.get(*image as usize).is_none_or(|image| image.len() != texels) {
                return Err(Error::Argument(format!("the colours of texture {number} must be {texels} texels")));
            }
        }
        if !self.images.iter().all(|image| image.is_finite()) {
            return Err(Error::Argument("the colours of textures must be finite".to_owned()));
        }
        Ok(())
    }

    /// Returns a texel of a texture, counted from its frame's first.
    pub(super) fn at(&self, texture: u32, at: usize) -> [f64; 3] {
        self.images[self.of_texture[texture as usize] as usize].at(at).map(f64::from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_for_values() {
        let values = Box::new(std::array::from_fn(|i| 1.0 / (1.0 + f32::from(u8::try_from(i).unwrap()))));
        let coded = ColourImage::Coded(vec![[0, 1, 255], [3, 0, 7]], values);
        let linear = ColourImage::Linear(vec![[1.0, 0.5, 1.0 / 256.0], [0.25, 1.0, 0.125]]);
        let colours = TextureColours { of_texture: vec![1, 0, 1], images: vec![Arc::new(coded), Arc::new(linear)] };
        for at in 0..2 {
            let own = colours.at(0, at);
            assert_eq!([colours.at(1, at), colours.at(2, at)], [own, own]);
        }
        assert_eq!(colours.at(1, 1), [0.25, 1.0, 0.125]);
    }
}
