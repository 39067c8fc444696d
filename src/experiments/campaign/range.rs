//! Writer of a range of runs into a dataset.

use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions},
    io::{Read, Seek, SeekFrom, Write},
    ops::RangeInclusive,
    path::{Path, PathBuf},
};

use super::{CampaignError, Dataset, dataset::read_journal, row::Row, table};

/// Adds the rows of a range of runs to a dataset.
pub(super) struct RangeWriter<'a> {
    dataset: &'a Dataset,
    /// First and last run.
    range: RangeInclusive<u64>,
    /// Incomplete chunks: the journal, and the number of missing runs of the range.
    open: BTreeMap<u64, (Option<File>, u64)>,
    /// Whether each run of the range is done.
    done: Vec<bool>,
    /// Lock while this exists: no other process computes the same range.
    _lock: Option<File>,
}

impl<'a> RangeWriter<'a> {
    /// Reads which runs are done. If another process computes the same range, waits until it ends.
    pub fn new(dataset: &'a Dataset, range: RangeInclusive<u64>) -> Result<Self, CampaignError> {
        let folder = dataset.folder().join("journal");
        let runtime = |path: &Path, e: std::io::Error| {
            CampaignError::Runtime(format!("{}: cannot be written: {e}", path.display()))
        };
        fs::create_dir_all(&folder).map_err(|e| runtime(&folder, e))?;
        let path = folder.join(format!("{}-{}.lock", range.start(), range.end()));
        let lock = File::create(&path).map_err(|e| runtime(&path, e))?;
        // Not every file system supports locks. Without one, two processes would do the same work, with the same
        // result.
        let lock = lock.lock().is_ok().then_some(lock);
        let size = dataset.manifest().chunk;
        if range == (0..=dataset.manifest().runs - 1) {
            dataset.remove_drafts();
        }
        let mut writer = Self {
            dataset,
            done: vec![false; (range.end() - range.start() + 1) as usize],
            open: BTreeMap::new(),
            _lock: lock,
            range: range.clone(),
        };
        for chunk in range.start() / size..=range.end() / size {
            let rows = dataset.rows_of(chunk)?;
            let runs = dataset.runs_of(chunk);
            let own = *runs.start().max(range.start())..=*runs.end().min(range.end());
            let mut missing = 0;
            for run in own {
                let done = rows.contains_key(&run);
                writer.done[(run - range.start()) as usize] = done;
                missing += u64::from(!done);
            }
            if missing > 0 {
                writer.open.insert(chunk, (None, missing));
            } else {
                dataset.complete(chunk)?;
            }
        }
        Ok(writer)
    }

    /// The runs that are missing, by ascending number.
    pub fn missing(&self) -> Vec<u64> {
        let runs = self.range.clone().zip(&self.done);
        runs.filter(|(_, done)| !**done)
            .map(|(run, _)| run)
            .collect()
    }

    /// Adds a row.
    pub fn add(&mut self, row: &Row) -> Result<(), CampaignError> {
        let chunk = row.run / self.dataset.manifest().chunk;
        let path = self.journal_path(chunk);
        let at = |e: std::io::Error| {
            CampaignError::Runtime(format!("{}: cannot be written: {e}", path.display()))
        };
        let Some((journal, missing)) = self.open.get_mut(&chunk) else {
            return Ok(());
        };
        let mut line = serde_json::to_vec(row).map_err(|e| at(e.into()))?;
        line.push(b'\n');
        let file = match journal {
            Some(file) => file,
            None => {
                let whole = read_journal(&path)?.1;
                let options = OpenOptions::new()
                    .create(true)
                    .truncate(false)
                    .read(true)
                    .write(true)
                    .open(&path);
                let mut file = options.map_err(at)?;
                // Removes a truncated line.
                file.set_len(whole).map_err(at)?;
                file.seek(SeekFrom::End(0)).map_err(at)?;
                journal.insert(file)
            }
        };
        file.write_all(&line).map_err(at)?;
        *missing -= 1;
        if *missing == 0
            && let Some((Some(journal), _)) = self.open.remove(&chunk)
        {
            self.close(chunk, journal)?;
        }
        Ok(())
    }

    /// Completes a chunk in which no run of the range is missing any more.
    fn close(&self, chunk: u64, mut journal: File) -> Result<(), CampaignError> {
        if self.complete(chunk)? == 0 {
            return Ok(());
        }
        // A process whose campaign has fewer runs has completed its table and removed the journal while a row was being
        // added.
        let path = self.journal_path(chunk);
        let mut text = Vec::new();
        let read = journal
            .rewind()
            .and_then(|()| journal.read_to_end(&mut text));
        read.map_err(|e| {
            CampaignError::Runtime(format!("{}: cannot be read: {e}", path.display()))
        })?;
        table::replace(&path, &text).map_err(CampaignError::Runtime)?;
        match self.complete(chunk)? {
            0 => Ok(()),
            lost => Err(CampaignError::Runtime(format!(
                "{}: {lost} rows are gone, since something has removed journals; the same command computes them again",
                path.display()
            ))),
        }
    }

    /// Writes the table of a chunk if all of its rows are done. Returns the number of rows of the range that are
    /// missing.
    fn complete(&self, chunk: u64) -> Result<usize, CampaignError> {
        let there = self.dataset.complete(chunk)?;
        let mut own = self.dataset.runs_of(chunk);
        let (first, last) = (*self.range.start(), *self.range.end());
        own = *own.start().max(&first)..=*own.end().min(&last);
        Ok(own.filter(|run| !there.contains(run)).count())
    }

    /// Journal of a chunk, which has its rows until the chunk is complete.
    fn journal_path(&self, chunk: u64) -> PathBuf {
        let (first, last) = (self.range.start(), self.range.end());
        let name = format!("part-{chunk:06}.{first}-{last}.jsonl");
        self.dataset.folder().join("journal").join(name)
    }
}
