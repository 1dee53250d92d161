//! [`Registers`] of AVX-512.
//!
//! What must not break: a [`Registers`] exists only where the processor has the instructions. All `unsafe` blocks rest on
//! that, or on two sizes being the same.

#![allow(unsafe_code, reason = "instructions of a processor level; each block says why it is sound")]

use std::arch::x86_64::{
    __m128i, __m256i, __m512, __m512d, __m512i, _CMP_GE_OQ, _CMP_GT_OQ, _CMP_LT_OQ, _MM_FROUND_NO_EXC,
    _MM_FROUND_TO_NEAREST_INT, _MM_FROUND_TO_POS_INF, _mm256_castsi128_si256, _mm256_inserti128_si256, _mm512_abs_pd,
    _mm512_add_epi32, _mm512_add_epi64, _mm512_add_pd, _mm512_and_si512, _mm512_castsi256_si512, _mm512_castsi512_pd,
    _mm512_cmp_pd_mask, _mm512_cmpeq_epi64_mask, _mm512_cvtepi64_pd, _mm512_cvtepu32_pd, _mm512_cvtpd_epi64,
    _mm512_div_pd, _mm512_inserti64x4, _mm512_mask_blend_epi64, _mm512_mask_blend_pd, _mm512_mask_cmp_pd_mask,
    _mm512_mask_or_epi64, _mm512_maskz_compress_epi32, _mm512_maskz_compress_epi64, _mm512_maskz_compress_pd,
    _mm512_maskz_compress_ps, _mm512_maskz_mov_pd, _mm512_mul_pd, _mm512_or_si512, _mm512_permutex2var_epi64,
    _mm512_roundscale_pd, _mm512_set_epi32, _mm512_set_epi64, _mm512_set1_epi32, _mm512_set1_epi64, _mm512_set1_pd,
    _mm512_setzero_pd, _mm512_slli_epi64, _mm512_srli_epi64, _mm512_sub_pd, _mm512_test_epi8_mask, _mm512_xor_pd,
};

use super::lines::{Happened, LANES, Lines, Progress, Setting};
use super::notes::{GROUP, Notes, TileSamples};
use crate::crossing::band_events::Key;
use crate::crossing::record::{COUNTER, Narrow};

/// The instructions: proof that the processor has them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Registers(());

/// Samples, of which those that a mask names can be moved to the front.
pub(crate) trait Compress: Sized {
    /// Writes those of 16 samples whose bits are set, in order. What else is written is meaningless.
    fn compress(registers: Registers, mask: u16, samples: &[Self; GROUP], to: &mut [Self]);
}

impl Registers {
    /// Returns them if this processor has them.
    pub(crate) fn find() -> Option<Self> {
        let has = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("popcnt")
            && is_x86_feature_detected!("bmi1");
        has.then_some(Self(()))
    }

    /// Writes the pixels and samples that are noted, in order; returns how many. What else is written is meaningless.
    #[inline]
    pub(crate) fn collect<S: Compress + Copy>(self, tile: &TileSamples<'_, S>, notes: Notes<'_, S>) -> usize {
        // SAFETY: `self` exists, so the processor has the instructions.
        unsafe { collect(self, tile, notes) }
    }

    /// Decides the lines as [`crate::crossing::decision::decide`] does, makes their events, and moves their records on.
    ///
    /// It ends before the first line that is not clear, or whose record is full.
    #[inline]
    #[allow(clippy::unused_self, reason = "it is the proof")]
    pub(crate) fn carry_out(
        self,
        lines: &Lines<'_>,
        at: Setting,
        records: &mut [Narrow],
        happened: Happened<'_>,
    ) -> Progress {
        // SAFETY: `self` exists, so the processor has the instructions.
        unsafe { carry_out(lines, at, records, happened) }
    }
}

impl Compress for f32 {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes the vector code of `collect`")]
    fn compress(_: Registers, mask: u16, samples: &[Self; GROUP], to: &mut [Self]) {
        #[target_feature(enable = "avx512f")]
        #[inline]
        fn compress(mask: u16, samples: &[f32; GROUP], to: &mut [f32]) {
            let samples: __m512 = load(samples);
            store(_mm512_maskz_compress_ps(mask, samples), first::<GROUP, _>(to));
        }
        // SAFETY: there are `Registers`, so the processor has the instructions.
        unsafe { compress(mask, samples, to) }
    }
}

impl Compress for f64 {
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "becomes the vector code of `collect`")]
    fn compress(_: Registers, mask: u16, samples: &[Self; GROUP], to: &mut [Self]) {
        #[target_feature(enable = "avx512f")]
        #[inline]
        fn compress(mask: u16, samples: &[f64; GROUP], to: &mut [f64]) {
            let [low, high] = mask.to_le_bytes();
            let halves = samples.as_chunks::<LANES>().0;
            store(_mm512_maskz_compress_pd(low, load(&halves[0])), first::<LANES, _>(to));
            let to = &mut to[low.count_ones() as usize..];
            store(_mm512_maskz_compress_pd(high, load(&halves[1])), first::<LANES, _>(to));
        }
        // SAFETY: there are `Registers`, so the processor has the instructions.
        unsafe { compress(mask, samples, to) }
    }
}

/// The first `N`, as a slice of known length.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn first<const N: usize, T>(values: &mut [T]) -> &mut [T; N] {
    values.first_chunk_mut().expect("room for a whole register")
}

/// A value of which every pattern of bits is one: safe to make of other such values.
trait Plain: Copy {}
impl Plain for __m128i {}
impl Plain for __m256i {}
impl Plain for __m512 {}
impl Plain for __m512d {}
impl Plain for __m512i {}
impl Plain for u8 {}
impl Plain for u32 {}
impl Plain for u64 {}
impl Plain for f32 {}
impl Plain for f64 {}
impl Plain for Key {}
impl Plain for Narrow {}

/// A register of these values.
#[inline(always)]
#[allow(clippy::inline_always, reason = "one instruction")]
fn load<R: Plain, T: Plain, const N: usize>(values: &[T; N]) -> R {
    const { assert!(size_of::<R>() == size_of::<[T; N]>()) };
    // SAFETY: there are as many bytes, and every pattern of them is an R.
    unsafe { std::ptr::from_ref(values).cast::<R>().read_unaligned() }
}

/// Writes a register.
#[inline(always)]
#[allow(clippy::inline_always, reason = "one instruction")]
fn store<R: Plain, T: Plain, const N: usize>(register: R, to: &mut [T; N]) {
    const { assert!(size_of::<R>() == size_of::<[T; N]>()) };
    // SAFETY: there are as many bytes, and every pattern of them is T's.
    unsafe { std::ptr::from_mut(to).cast::<R>().write_unaligned(register) }
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,popcnt")]
fn collect<S: Compress + Copy>(registers: Registers, tile: &TileSamples<'_, S>, notes: Notes<'_, S>) -> usize {
    const BLOCK: usize = 64;
    /// Up to here, one after the other takes less time.
    const FEW: u32 = 4;
    let TileSamples { noted, start, last, new } = *tile;
    let Notes { pixel, from, to } = notes;
    let n = noted.len();
    let (last, new) = (&last[..n], &new[..n]);
    let positions = _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
    let (blocks, rest) = noted.as_chunks::<BLOCK>();
    let (last_groups, new_groups) = (last.as_chunks::<GROUP>().0, new.as_chunks::<GROUP>().0);
    let mut count = 0;
    for (block, noted) in blocks.iter().enumerate() {
        let bytes: __m512i = load(noted);
        let mut mask = _mm512_test_epi8_mask(bytes, bytes);
        if mask.count_ones() <= FEW {
            while mask != 0 {
                let i = block * BLOCK + mask.trailing_zeros() as usize;
                #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
                let in_band = start + i as u32;
                (pixel[count], from[count], to[count]) = (in_band, last[i], new[i]);
                count += 1;
                mask &= mask - 1;
            }
            continue;
        }
        for group in block * (BLOCK / GROUP)..(block + 1) * (BLOCK / GROUP) {
            #[allow(clippy::cast_possible_truncation, reason = "of a group")]
            let of_group = mask as u16;
            #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
            let first_pixel = start + (group * GROUP) as u32;
            let pixels = _mm512_add_epi32(positions, _mm512_set1_epi32(first_pixel.cast_signed()));
            store(_mm512_maskz_compress_epi32(of_group, pixels), first::<GROUP, _>(&mut pixel[count..]));
            S::compress(registers, of_group, &last_groups[group], &mut from[count..]);
            S::compress(registers, of_group, &new_groups[group], &mut to[count..]);
            count += of_group.count_ones() as usize;
            mask >>= GROUP;
        }
    }
    for (i, &noted) in (n - rest.len()..).zip(rest) {
        #[allow(clippy::cast_possible_truncation, reason = "no sensor has 2^32 pixels")]
        let in_band = start + i as u32;
        (pixel[count], from[count], to[count]) = (in_band, last[i], new[i]);
        count += usize::from(noted);
    }
    count
}

/// The bases and the words of eight records.
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
#[inline]
fn gather(records: &[Narrow], pixel: &[u32; LANES]) -> (__m512d, __m512i) {
    let one = |lane: usize| -> __m128i { load(std::array::from_ref(&records[pixel[lane] as usize])) };
    let two = |lane: usize| _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(one(lane)), one(lane + 1));
    let four = |lane: usize| _mm512_inserti64x4::<1>(_mm512_castsi256_si512(two(lane)), two(lane + 2));
    let (low, high) = (four(0), four(4));
    let (even, odd) = (_mm512_set_epi64(14, 12, 10, 8, 6, 4, 2, 0), _mm512_set_epi64(15, 13, 11, 9, 7, 5, 3, 1));
    let base = _mm512_permutex2var_epi64(low, even, high);
    (_mm512_castsi512_pd(base), _mm512_permutex2var_epi64(low, odd, high))
}

/// Bits of the lowest lanes.
#[inline(always)]
#[allow(clippy::inline_always, reason = "becomes its callers' vector code")]
fn lowest(lanes: usize) -> u8 {
    if lanes < LANES { (1 << lanes) - 1 } else { u8::MAX }
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,popcnt,bmi1")]
#[allow(clippy::cast_possible_wrap, reason = "patterns of bits")]
fn carry_out(lines: &Lines<'_>, at: Setting, records: &mut [Narrow], happened: Happened<'_>) -> Progress {
    let (count, Happened { after, keys, old }) = (lines.count, happened);
    let sign_bit = _mm512_set1_pd(-0.0);
    let (half, one, zero) = (_mm512_set1_pd(0.5), _mm512_set1_pd(1.0), _mm512_setzero_pd());
    let ticks = _mm512_set1_pd(at.ticks);
    let [first_pixel, rows_per_pixel, to_next_row] = at.grid.parts().map(|part| _mm512_set1_pd(part));
    let counter = _mm512_set1_epi64(COUNTER as i64);
    let off_counter = _mm512_slli_epi64::<16>(counter);
    let both_counters = _mm512_or_si512(counter, off_counter);

    let mut progress = Progress::default();
    while progress.lines < count {
        let start = progress.lines;
        let pixel: &[u32; LANES] = lines.pixel[start..].first_chunk().expect("lanes beyond the last line");
        let lanes_of = |values: &[f64]| -> __m512d {
            load(values[start..].first_chunk::<LANES>().expect("lanes beyond the last line"))
        };
        let (from, to) = (lanes_of(lines.from), lanes_of(lines.to));
        let (c_on, c_off) = (lanes_of(lines.steps.on), lanes_of(lines.steps.off));
        let (base, word) = gather(records, pixel);

        // From here to `single` and `nothing`: see `decision::decide` and `line_candidates`.
        let on = _mm512_cvtepi64_pd(_mm512_and_si512(word, counter));
        let off = _mm512_cvtepi64_pd(_mm512_and_si512(_mm512_srli_epi64::<16>(word), counter));
        let (up, down) = (_mm512_mul_pd(on, c_on), _mm512_mul_pd(off, c_off));
        let reference = _mm512_add_pd(base, _mm512_sub_pd(up, down));
        let magnitude = _mm512_add_pd(_mm512_add_pd(_mm512_abs_pd(base), up), down);
        let magnitude = _mm512_add_pd(_mm512_add_pd(magnitude, c_on), c_off);
        let error = _mm512_mul_pd(_mm512_set1_pd(8.0 * f64::EPSILON), magnitude);
        let minus_error = _mm512_xor_pd(error, sign_bit);
        let accurate = _mm512_cmp_pd_mask::<_CMP_LT_OQ>(error, _mm512_set1_pd(1e-10));
        let highest = _mm512_sub_pd(_mm512_add_pd(reference, c_on), error);
        let lowest_value = _mm512_add_pd(_mm512_sub_pd(reference, c_off), error);
        let nothing = _mm512_mask_cmp_pd_mask::<_CMP_LT_OQ>(accurate, to, highest);
        let nothing = _mm512_mask_cmp_pd_mask::<_CMP_GT_OQ>(nothing, to, lowest_value);

        let brighter = _mm512_cmp_pd_mask::<_CMP_GT_OQ>(to, reference);
        let sign = _mm512_maskz_mov_pd(!brighter, sign_bit);
        let step = _mm512_xor_pd(_mm512_mask_blend_pd(brighter, c_off, c_on), sign);
        let level = _mm512_add_pd(reference, step);
        let change = _mm512_sub_pd(to, from);
        let scale = _mm512_div_pd(ticks, change);
        let estimate = _mm512_mul_pd(_mm512_sub_pd(level, from), scale);
        let doubt = _mm512_mul_pd(_mm512_mul_pd(error, _mm512_abs_pd(scale)), _mm512_set1_pd(1.01));
        let rounding = _mm512_mul_pd(_mm512_set1_pd(4.0 * f64::EPSILON), _mm512_abs_pd(estimate));
        let doubt = _mm512_add_pd(doubt, rounding);
        let ceiling = _mm512_roundscale_pd::<{ _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC }>(estimate);

        let past_level = _mm512_xor_pd(_mm512_sub_pd(to, level), sign);
        let past_next = _mm512_xor_pd(_mm512_sub_pd(to, _mm512_add_pd(level, step)), sign);
        let after_tick_before = _mm512_sub_pd(estimate, _mm512_sub_pd(ceiling, one));
        let single = _mm512_mask_cmp_pd_mask::<_CMP_GT_OQ>(accurate, past_level, error);
        let single = _mm512_mask_cmp_pd_mask::<_CMP_LT_OQ>(single, past_next, minus_error);
        let single = _mm512_mask_cmp_pd_mask::<_CMP_GT_OQ>(single, _mm512_xor_pd(change, sign), zero);
        let single = _mm512_mask_cmp_pd_mask::<_CMP_GE_OQ>(single, ceiling, one);
        let single = _mm512_mask_cmp_pd_mask::<_CMP_GT_OQ>(single, _mm512_sub_pd(ceiling, estimate), doubt);
        let single = _mm512_mask_cmp_pd_mask::<_CMP_GT_OQ>(single, after_tick_before, doubt);

        // Events as `Key::new` and `Grid::address` make them, and words as `Narrow::stepped` does.
        let tick = _mm512_cvtpd_epi64(ceiling);
        let pixels: __m256i = load(pixel);
        let pixels = _mm512_add_pd(_mm512_cvtepu32_pd(pixels), first_pixel);
        let row = _mm512_sub_pd(_mm512_mul_pd(_mm512_add_pd(pixels, half), rows_per_pixel), half);
        let row = _mm512_roundscale_pd::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(row);
        let address = _mm512_cvtpd_epi64(_mm512_add_pd(pixels, _mm512_mul_pd(row, to_next_row)));
        let polarity = _mm512_set1_epi64(1 << (Key::TICK - 1));
        let address = _mm512_mask_or_epi64(address, brighter, address, polarity);
        let key = _mm512_or_si512(_mm512_slli_epi64::<{ Key::TICK }>(tick), address);
        let its_counter = _mm512_mask_blend_epi64(brighter, off_counter, counter);
        let full = _mm512_cmpeq_epi64_mask(_mm512_and_si512(word, its_counter), its_counter);
        let raise = _mm512_mask_blend_epi64(brighter, _mm512_set1_epi64(1 << 16), _mm512_set1_epi64(1));
        let raised = _mm512_and_si512(_mm512_add_epi64(word, raise), both_counters);
        let time = _mm512_slli_epi64::<32>(_mm512_add_epi64(tick, _mm512_set1_epi64(at.since)));
        let stepped: __m512i = _mm512_mask_or_epi64(word, single, raised, time);

        let not_clear = lowest(count - start) & ((single & full) | !(single | nothing));
        let mut words = [0; LANES];
        store(stepped, &mut words);
        let mut put = |lane: usize| records[pixel[lane] as usize].set_word(words[lane]);
        // A branch, so that the next lines need not wait for these.
        let (done, events) = if not_clear == 0 && count - start >= LANES {
            (0..LANES).for_each(&mut put);
            (LANES, single)
        } else {
            let done = (count - start).min(not_clear.trailing_zeros() as usize);
            (0..done).for_each(&mut put);
            (done, single & lowest(done))
        };
        store(_mm512_mask_blend_pd(single, reference, level), first::<LANES, _>(&mut after[start..]));
        store(_mm512_maskz_compress_epi64(events, key), first::<LANES, _>(&mut keys[progress.events..]));
        store(_mm512_maskz_compress_epi64(events, word), first::<LANES, _>(&mut old[progress.events..]));
        progress.events += events.count_ones() as usize;
        progress.lines += done;
        if not_clear != 0 {
            progress.is_full = single & full != 0;
            break;
        }
    }
    progress
}
