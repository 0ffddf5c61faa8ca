//! RVL, a lossless coding of depth images: Wilson 2017, *Fast Lossless Depth Image Compression*.
//!
//! Pixels stand row by row in runs: how many are 0, how many are not, and of each of these the difference from the last that
//! was not, of all rows, as `2 d` or `−2 d − 1`. A number is in digits of three bits, the least first, each below a bit that
//! says whether more follow; eight of them make a word of 32 bits, the highest first. There is no checksum.
//!
//! Before the words stand, as `compressed_depth_image_transport` writes them, columns and rows. All is little-endian.

use crate::record::Fields;

/// An image as it is coded.
pub(crate) struct Rvl<'a> {
    pub(crate) rows: u32,
    pub(crate) columns: u32,
    words: &'a [u8],
}

impl<'a> Rvl<'a> {
    /// Takes the image apart; `None` where its size is not whole.
    pub(crate) fn parse(bytes: &'a [u8]) -> Option<Rvl<'a>> {
        let mut fields = Fields(bytes);
        let (columns, rows) = (fields.u32()?, fields.u32()?);
        Some(Rvl { rows, columns, words: fields.0 })
    }

    /// Hands over its pixels, row by row, and no more than it says it has; or what is wrong with it, after those before.
    pub(crate) fn decode(&self, mut take: impl FnMut(u16)) -> Result<(), &'static str> {
        const TOO_MANY: &str = "it has more pixels than it says";
        let mut numbers = Numbers { words: self.words.as_chunks().0.iter(), word: 0, n_digits: 0 };
        let mut n_left = u64::from(self.rows) * u64::from(self.columns);
        // Differences are those of 16 bits: what goes round is meant to.
        let mut pixel = 0_u16;
        while n_left > 0 {
            let n_zeros = numbers.take()?.into();
            n_left = n_left.checked_sub(n_zeros).ok_or(TOO_MANY)?;
            (0..n_zeros).for_each(|_| take(0));
            let n_others = numbers.take()?.into();
            n_left = n_left.checked_sub(n_others).ok_or(TOO_MANY)?;
            for _ in 0..n_others {
                let coded = numbers.take()?;
                pixel = pixel.wrapping_add(((coded >> 1) ^ (coded & 1).wrapping_neg()) as u16);
                take(pixel);
            }
        }
        Ok(())
    }
}

/// The numbers in words.
struct Numbers<'a> {
    words: std::slice::Iter<'a, [u8; 4]>,
    word: u32,
    /// Digits of the word that are left.
    n_digits: u32,
}

impl Numbers<'_> {
    fn take(&mut self) -> Result<u32, &'static str> {
        let mut number = 0;
        for n_bits in (0..u32::BITS).step_by(3) {
            if self.n_digits == 0 {
                let word = self.words.next().ok_or("it ends before its last pixel")?;
                (self.word, self.n_digits) = (u32::from_le_bytes(*word), 8);
            }
            let digit = self.word >> 28;
            (self.word, self.n_digits) = (self.word << 4, self.n_digits - 1);
            number |= (digit & 7) << n_bits;
            if digit & 8 == 0 {
                return Ok(number);
            }
        }
        Err("a number in it has more than 32 bits")
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Codes an image, digit by digit.
    fn encode(columns: usize, pixels: &[u16]) -> Vec<u8> {
        let mut digits = Vec::new();
        let mut push = |mut number: u32| loop {
            let more = number > 7;
            digits.push(number & 7 | u32::from(more) << 3);
            number >>= 3;
            if !more {
                break;
            }
        };
        let (mut rest, mut last) = (pixels, 0);
        while !rest.is_empty() {
            let n_zeros = rest.iter().take_while(|&&pixel| pixel == 0).count();
            let n_others = rest[n_zeros..].iter().take_while(|&&pixel| pixel != 0).count();
            push(n_zeros as u32);
            push(n_others as u32);
            for &pixel in &rest[n_zeros..n_zeros + n_others] {
                let difference = i32::from(pixel) - i32::from(last);
                push(if difference < 0 { -2 * difference - 1 } else { 2 * difference } as u32);
                last = pixel;
            }
            rest = &rest[n_zeros + n_others..];
        }
        let mut bytes = [columns as u32, (pixels.len() / columns) as u32].map(u32::to_le_bytes).concat();
        for word in digits.chunks(8) {
            let word: u32 = word.iter().zip((0..8).rev()).map(|(digit, place)| digit << (4 * place)).sum();
            bytes.extend(word.to_le_bytes());
        }
        bytes
    }

    fn decode(bytes: &[u8]) -> Result<Vec<u16>, &'static str> {
        let mut pixels = Vec::new();
        Rvl::parse(bytes).unwrap().decode(|pixel| pixels.push(pixel))?;
        Ok(pixels)
    }

    /// Pixels as in depth images: runs without measurement, and runs of which each is like the one before, or any.
    fn pixels() -> impl Strategy<Value = Vec<u16>> {
        let run = prop_oneof![
            prop::collection::vec(Just(0), 0..40),
            prop::collection::vec(any::<u16>(), 0..40),
            (any::<u16>(), prop::collection::vec(-9_i16..9, 0..40)).prop_map(|(first, steps)| {
                let next = |pixel: &mut u16, step: &i16| {
                    *pixel = pixel.wrapping_add_signed(*step);
                    Some(*pixel)
                };
                steps.iter().scan(first, next).collect()
            }),
        ];
        prop::collection::vec(run, 0..9).prop_map(|runs| runs.concat())
    }

    proptest! {
        #[test]
        fn what_was_coded_is_decoded(pixels in pixels()) {
            let bytes = encode(1, &pixels);
            prop_assert_eq!(decode(&bytes), Ok(pixels.clone()));
            let image = Rvl::parse(&bytes).unwrap();
            prop_assert_eq!((image.columns, image.rows as usize), (1, pixels.len()));
        }

        #[test]
        fn what_is_cut_off_is_refused(pixels in pixels(), cut in any::<prop::sample::Index>()) {
            prop_assume!(!pixels.is_empty());
            let bytes = encode(1, &pixels);
            let at = 8 + cut.index(bytes.len() - 8);
            prop_assert_eq!(decode(&bytes[..at]), Err("it ends before its last pixel"));
        }

        #[test]
        fn any_bytes_give_at_most_the_pixels_that_they_say(
            columns in 0_u32..50, rows in 0_u32..50, words in prop::collection::vec(any::<u8>(), 0..200)
        ) {
            let mut n_pixels = 0;
            let decoded = Rvl { rows, columns, words: &words }.decode(|_| n_pixels += 1);
            prop_assert!(n_pixels <= rows * columns);
            prop_assert!(decoded.is_err() || n_pixels == rows * columns);
        }
    }

    /// Three rows of four, and their words by the packages pyrvl 0.0.1 and rvl 1.0.4, which take differences of 17 and of 16 bits.
    #[test]
    fn words_of_other_programs_are_decoded() {
        let pixels = [0, 0, 100, 102, 105, 0, 0, 65535, 1, 2, 3, 0];
        for words in ["623489233bffdc4c2132ffff00000000", "623489232142a34b00000000"] {
            let bytes = (0..words.len()).step_by(2);
            let words: Vec<u8> =
                bytes.map(|at| u8::from_str_radix(&words[at..at + 2], 16).unwrap()).collect();
            let bytes = [&[4, 0, 0, 0, 3, 0, 0, 0], &words[..]].concat();
            assert_eq!(decode(&bytes).as_deref(), Ok(&pixels[..]));
        }
    }

    #[test]
    fn a_number_without_end_is_refused() {
        let bytes = [&[1, 0, 0, 0, 1, 0, 0, 0][..], &[0xff; 8]].concat();
        assert_eq!(decode(&bytes), Err("a number in it has more than 32 bits"));
    }

    #[test]
    fn runs_beyond_the_last_pixel_are_refused() {
        let bytes = |n_rows: u8| {
            let mut bytes = encode(1, &[0, 0, 7, 9]);
            bytes[4] = n_rows;
            bytes
        };
        assert_eq!(decode(&bytes(4)).as_deref(), Ok(&[0, 0, 7, 9][..]));
        for n_rows in [1, 3] {
            assert_eq!(decode(&bytes(n_rows)), Err("it has more pixels than it says"));
        }
    }
}
