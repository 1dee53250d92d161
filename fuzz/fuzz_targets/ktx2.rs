#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| davis_rs_fuzz::bodies::ktx2(data));
