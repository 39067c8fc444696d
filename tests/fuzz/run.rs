//! Runs a target on mutated inputs.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use rand::SeedableRng;
use rand::rngs::StdRng;

use crate::mutate::mutated;

/// Number of targets, which share the time.
const TARGETS: u32 = 6;
/// Time for one input; several times what the worst valid one takes.
const SLOWEST: Duration = Duration::from_secs(10);

/// One kind of input.
pub struct Target<'a> {
    /// Its name.
    pub name: &'a str,
    /// Valid inputs.
    pub corpus: Vec<Vec<u8>>,
    /// Words of the format.
    pub words: &'a [&'a str],
    /// Memory that an input may need \[bytes\], independent of its size.
    pub memory: u64,
}

impl Target<'_> {
    /// Calls `read` with every input of the corpus and then with mutated ones.
    pub fn run(mut self, mut read: impl FnMut(&[u8])) {
        let number = |name: &str| std::env::var(name).ok()?.parse::<u64>().ok();
        let (time, seed) = match number("FUYU_FUZZ_SECONDS") {
            None => (Duration::from_secs(1), 1),
            Some(seconds) => {
                let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
                let seed = now.map_or(0, |now| now.as_nanos() as u64);
                (Duration::from_secs(seconds) / TARGETS, seed)
            }
        };
        let seed = number("FUYU_FUZZ_SEED").unwrap_or(seed);
        self.corpus.extend(known_failures(self.name));
        let mut rng = StdRng::seed_from_u64(seed);
        let start = Instant::now();
        for input in &self.corpus {
            self.check(input, seed, 0, &mut read);
        }
        let mut count = 0;
        while start.elapsed() < time {
            count += 1;
            let input = mutated(&self.corpus, self.words, &mut rng);
            self.check(&input, seed, count, &mut read);
        }
        println!(
            "{}: {count} inputs in {:.0?}, seed {seed}",
            self.name,
            start.elapsed()
        );
        assert!(count > 0, "{}: no time for inputs", self.name);
    }

    fn check(&self, input: &[u8], seed: u64, count: u64, read: &mut impl FnMut(&[u8])) {
        let file = folder().join(format!("{}.input", self.name));
        fs::write(&file, input).unwrap();
        let start = Instant::now();
        let mut outcome = Ok(());
        let memory = allocation_counter::measure(|| {
            outcome = catch_unwind(AssertUnwindSafe(|| read(input)));
        });
        let place = format!(
            "{}, seed {seed}, input {count}, {}",
            self.name,
            file.display()
        );
        assert!(outcome.is_ok(), "panic: {place}");
        let most = memory.bytes_max;
        // What is read may take a thousand times the input: 24 bytes for a value of one, columns with their names.
        let allowed = self.memory + 1000 * input.len() as u64;
        assert!(most <= allowed, "{most} bytes for {}: {place}", input.len());
        assert!(start.elapsed() < SLOWEST, "{:?}: {place}", start.elapsed());
        fs::remove_file(&file).unwrap();
    }
}

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("fuzz");
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn known_failures(target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus");
    let files = fs::read_dir(folder.join(target));
    let files = files.into_iter().flatten();
    files
        .map(|file| fs::read(file.unwrap().path()).unwrap())
        .collect()
}

/// The files with this ending in a folder of the project.
pub fn files(folder: &str, ending: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut paths: Vec<_> = (fs::read_dir(folder).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == ending))
        .collect();
    paths.sort();
    assert!(!paths.is_empty());
    paths
        .into_iter()
        .map(|path| fs::read(path).unwrap())
        .collect()
}
