//! Colours of textures: their texels as red, green and blue.
//!
//! Glossy surfaces show colours, because what they reflect is coloured, and light that bounces takes them with it. A
//! texture of 8 bits stays so, because three float32 a texel are the largest part of what a scene with large textures
//! takes.
//!
//! What must not break: a texel has the same value however it is stored.

use std::sync::Arc;

use super::texture::{Texture, checked_layouts, framed};
use crate::error::{Error, Result};

/// The texels of a texture row by row, in a frame of one texel around it.
#[derive(Clone, Debug)]
pub struct ColourImage {
    pub(crate) texture: Texture,
    texels: Texels,
}

#[derive(Clone, Debug)]
enum Texels {
    /// Red, green and blue.
    Linear(Vec<[f32; 3]>),
    /// The same as 8-bit numbers, and the red, green and blue that each number stands for.
    Coded(Vec<[u8; 3]>, Box<[[f32; 3]; 256]>),
}

impl ColourImage {
    /// Takes texels (red, green and blue) of a width, a height and a wrap mode (0 repeat, 1 clamp, 2 mirror).
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for another number of texels, or what is not finite.
    pub fn linear(layout: [i64; 3], texels: &[[f32; 3]]) -> Result<Self> {
        check_finite(texels)?;
        let (texture, texels) = with_frame(layout, texels)?;
        Ok(Self { texture, texels: Texels::Linear(texels) })
    }

    /// Takes texels as 8-bit numbers; `values` are the red, green and blue that each number stands for.
    ///
    /// # Errors
    ///
    /// As [`Self::linear`], or for other than 256 values.
    pub fn coded(layout: [i64; 3], texels: &[[u8; 3]], values: &[[f32; 3]]) -> Result<Self> {
        check_finite(values)?;
        let Ok(values) = <[[f32; 3]; 256]>::try_from(values) else {
            return Err(Error::Argument(format!("numbers of 8 bits stand for 256 colours, got {}", values.len())));
        };
        let (texture, texels) = with_frame(layout, texels)?;
        Ok(Self { texture, texels: Texels::Coded(texels, Box::new(values)) })
    }

    /// Returns a texel, counted from the frame's first.
    #[inline]
    pub(crate) fn at(&self, at: usize) -> [f32; 3] {
        match &self.texels {
            Texels::Linear(texels) => texels[at],
            Texels::Coded(texels, values) => {
                let [red, green, blue] = texels[at].map(usize::from);
                [values[red][0], values[green][1], values[blue][2]]
            }
        }
    }
}

fn check_finite(colours: &[[f32; 3]]) -> Result<()> {
    match colours.iter().flatten().find(|x| !x.is_finite()) {
        None => Ok(()),
        Some(x) => Err(Error::Argument(format!("the colours of textures must be finite, got {x}"))),
    }
}

fn with_frame<T: Copy>([width, height, wrap]: [i64; 3], texels: &[T]) -> Result<(Texture, Vec<T>)> {
    let mut textures = checked_layouts(&[[0, width, height, wrap]], None, 1)?;
    let texture = textures.remove(0);
    let count = texture.width as usize * texture.height as usize;
    if texels.len() != count {
        return Err(Error::Argument(format!(
            "a texture of {width} x {height} has {count} texels, got {}",
            texels.len()
        )));
    }
    let texels = framed(texels, texture.width as usize, texture.wrap);
    Ok((texture, texels))
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
    /// Checks that each texture has an image that is there.
    pub(crate) fn check(&self) -> Result<()> {
        match self.of_texture.iter().find(|&&image| image as usize >= self.images.len()) {
            None => Ok(()),
            Some(image) => Err(Error::Argument(format!("there are {} images, got number {image}", self.images.len()))),
        }
    }

    /// Checks that each of a scene's textures has an image of its size.
    pub(crate) fn check_sizes(&self, textures: &[Texture]) -> Result<()> {
        self.check()?;
        if self.of_texture.len() != textures.len() {
            let (given, count) = (self.of_texture.len(), textures.len());
            return Err(Error::Argument(format!("colours are given of {count} textures, got {given}")));
        }
        for (number, (texture, image)) in textures.iter().zip(&self.of_texture).enumerate() {
            let own = &self.images[*image as usize].texture;
            if (own.width, own.height, own.wrap) != (texture.width, texture.height, texture.wrap) {
                return Err(Error::Argument(format!(
                    "the colours of texture {number} must be {} x {} texels, and wrap as it does",
                    texture.width, texture.height
                )));
            }
        }
        Ok(())
    }

    /// Returns the image of a texture.
    #[inline]
    pub(crate) fn of(&self, texture: u32) -> &ColourImage {
        &self.images[self.of_texture[texture as usize] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What numbers of 8 bits stand for may differ between red, green and blue.
    #[test]
    fn numbers_stand_for_values() {
        let values: Vec<[f32; 3]> = (0..=255u8).map(|i| [1.0, 2.0, 4.0].map(|by| by / (1.0 + f32::from(i)))).collect();
        let numbers = [[0, 1, 255], [3, 0, 7]];
        let colours = [[1.0, 1.0, 4.0 / 256.0], [0.25, 2.0, 0.5]];
        let coded = ColourImage::coded([2, 1, 0], &numbers, &values).unwrap();
        let linear = ColourImage::linear([2, 1, 0], &colours).unwrap();
        let all = TextureColours { of_texture: vec![1, 0, 1], images: vec![Arc::new(coded), Arc::new(linear)] };
        for at in 0..12 {
            let repeated = colours[[1, 0, 1, 0][at % 4]];
            assert_eq!([0, 1, 2].map(|texture| all.of(texture).at(at)), [repeated; 3]);
        }
    }

    #[test]
    fn what_is_no_texture_is_refused() {
        let values = vec![[0.5; 3]; 256];
        assert!(ColourImage::coded([2, 1, 0], &[[0; 3]; 2], &values).is_ok());
        assert!(ColourImage::coded([2, 1, 0], &[[0; 3]; 2], &values[1..]).is_err());
        assert!(ColourImage::coded([2, 1, 0], &[[0; 3]; 2], &vec![[f32::NAN; 3]; 256]).is_err());
        assert!(ColourImage::coded([2, 1, 3], &[[0; 3]; 2], &values).is_err());
        assert!(ColourImage::coded([2, 2, 0], &[[0; 3]; 2], &values).is_err());
        assert!(ColourImage::linear([0, 1, 0], &[]).is_err());
        assert!(ColourImage::linear([1, 1, 0], &[[f32::INFINITY; 3]]).is_err());
    }
}
