//! Fuzzing of everything that is read from files and from the network: bags, URDF, YAML, CSV, message definitions and CDR.
//!
//! Each test mutates a corpus for a while and fails if an input makes fuyu panic, allocate more than its documented bound
//! or take seconds. Without a setting each runs for about a second with the same inputs every time; in CI and on demand
//! longer, with other inputs every time:
//!
//! ```sh
//! FUYU_FUZZ_SECONDS=120 cargo test --release --test fuzz    # in total
//! FUYU_FUZZ_SEED=1234 ...                                   # the inputs of a run that failed
//! ```
//!
//! The input in use is in `target/fuzz/TARGET.input`, also after a crash that ends the process. Inputs that once failed
//! belong into `tests/fuzz/corpus/TARGET/`.
//!
//! This is a mutator of our own rather than libFuzzer (cargo-fuzz, bolero), whose instrumentation needs a nightly compiler.
//! It has no feedback about coverage; instead its corpus covers the formats, and checksums are removed from it.

mod bags;
mod cdr;
mod mutate;
mod run;
mod texts;
