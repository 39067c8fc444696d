//! Dataset: the folder of a campaign, with results as Parquet tables of [`CHUNK`] runs each, and journals of incomplete
//! tables.
//!
//! ```text
//! campaign.json                    texts of campaign and scenario, columns
//! results/part-000012.parquet      a row per run: inputs, results, verdict
//! wall_time/part-000012.parquet    wall time of each run
//! journal/part-000012.0-9999.jsonl rows of a table that is not complete, as the process for runs 0 to 9999 adds them
//! journal/*.lock                   locks of ranges, and of the tables
//! series/, bags/                   what else is kept
//! ```
//! The bytes in `results` depend only on the campaign, not on the order of runs, the number of processes, or how often
//! they were killed.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{self, File},
    io::Read,
    ops::RangeInclusive,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use super::{
    Campaign, CampaignError,
    row::{Cell, Column, ColumnKind, Row, Verdict},
    table,
};
use crate::{experiments::Fleet, input_file};

/// Number of runs in a table.
pub(super) const CHUNK: u64 = 256;

/// Largest `campaign.json` \[bytes\].
const LARGEST_MANIFEST: u64 = 64 << 20;

/// Content of `campaign.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the program.
    pub version: String,
    /// Name of the campaign.
    pub name: String,
    /// Path of the campaign's file when the campaign was started.
    pub campaign_path: PathBuf,
    /// The file's text.
    pub campaign: String,
    /// Path of the scenario's file when the campaign was started.
    pub scenario_path: PathBuf,
    /// The file's text.
    pub scenario: String,
    /// Hash of the robot descriptions.
    pub descriptions: String,
    /// Number of runs.
    pub runs: u64,
    /// Runs in a table.
    pub chunk: u64,
    /// The dispersed parameters.
    pub parameters: Vec<Column>,
    /// The kept results.
    pub results: Vec<Column>,
    /// The criteria of success.
    pub success: Vec<String>,
}

/// The folder of a campaign.
#[derive(Debug, Clone)]
pub struct Dataset {
    folder: PathBuf,
    manifest: Manifest,
}

impl Campaign {
    fn manifest(&self) -> Result<Manifest, String> {
        let absolute = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
        Ok(Manifest {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            name: self.name(),
            campaign_path: absolute(&self.path),
            campaign: self.text.clone(),
            scenario_path: absolute(self.scenario.path()),
            scenario: self.scenario_text.clone(),
            descriptions: self.description_hash()?,
            runs: self.runs,
            chunk: CHUNK,
            parameters: self.parameters.clone(),
            results: self.results.clone(),
            success: self.criteria.iter().map(|c| c.text().to_owned()).collect(),
        })
    }

    /// Hash of the descriptions: robots and targets may be files outside the campaign.
    fn description_hash(&self) -> Result<String, String> {
        let fleet = Fleet::new(&self.scenario)?;
        let mut texts = String::new();
        for (namespace, _) in fleet.robots() {
            let dynamics = self.scenario.of_robot(namespace).dynamics()?;
            texts += &dynamics.robot.xml;
            for target in &dynamics.targets {
                texts += &target.description.xml;
            }
        }
        Ok(format!("{:016x}", fuyu_campaign::text_hash(&texts)))
    }
}

impl Dataset {
    /// The dataset of `campaign` in `folder`. The folder is created, or continued if it has the same campaign.
    ///
    /// # Errors
    /// [`CampaignError::Input`] if the folder has other content, [`CampaignError::Runtime`] if it cannot be written.
    pub fn create(campaign: &Campaign, folder: &Path) -> Result<Self, CampaignError> {
        let manifest = campaign.manifest().map_err(CampaignError::Input)?;
        let path = folder.join("campaign.json");
        if path.exists() {
            let old = Self::open(folder)?.manifest;
            let input = |e: String| Err(CampaignError::Input(format!("{}: {e}", folder.display())));
            if let Some(what) = difference(&old, &manifest) {
                return input(format!(
                    "holds a campaign with another {what}; give a new folder"
                ));
            }
            if manifest.runs < old.runs {
                return input(format!(
                    "holds a campaign of {} runs; give at least as many, or a new folder",
                    old.runs
                ));
            }
            if manifest.runs > old.runs && campaign.depends_on_runs() {
                return input(format!(
                    "holds {} runs of a Latin hypercube, which cannot grow; give as many, or a new folder",
                    old.runs
                ));
            }
            if manifest.runs == old.runs {
                return Ok(Self {
                    folder: folder.to_owned(),
                    manifest: old,
                });
            }
        } else if folder.exists() {
            // A killed process may have left only a draft of campaign.json.
            let is_draft = |entry: std::io::Result<fs::DirEntry>| {
                entry.is_ok_and(|e| {
                    e.file_name()
                        .to_string_lossy()
                        .starts_with(".campaign.json.")
                })
            };
            let is_empty = fs::read_dir(folder).map(|mut entries| entries.all(is_draft));
            match is_empty {
                Ok(true) => {}
                Ok(false) => {
                    let text = format!(
                        "{}: is not empty and holds no campaign; give a new folder",
                        folder.display()
                    );
                    return Err(CampaignError::Input(text));
                }
                Err(e) => {
                    let text = format!("{}: cannot be read: {e}", folder.display());
                    return Err(CampaignError::Input(text));
                }
            }
        }
        let text = serde_json::to_string_pretty(&manifest);
        let text = text.map_err(|e| CampaignError::Runtime(e.to_string()))?;
        fs::create_dir_all(folder).map_err(|e| {
            CampaignError::Input(format!("{}: cannot be created: {e}", folder.display()))
        })?;
        table::replace(&path, text.as_bytes()).map_err(CampaignError::Runtime)?;
        Ok(Self {
            folder: folder.to_owned(),
            manifest,
        })
    }

    /// The dataset in `folder`.
    ///
    /// # Errors
    /// [`CampaignError::Input`] if there is none.
    pub fn open(folder: &Path) -> Result<Self, CampaignError> {
        let path = folder.join("campaign.json");
        let text = input_file::read_text(&path, LARGEST_MANIFEST).map_err(|e| {
            CampaignError::Input(match e.is_missing() {
                true => format!(
                    "{}: is no folder of a campaign; `fuyu campaign run CONFIG --output DIR` makes one",
                    folder.display()
                ),
                false => e.to_string(),
            })
        })?;
        let manifest: Manifest = serde_json::from_str(&text).map_err(|e| {
            CampaignError::Input(format!("{}: is not what fuyu wrote: {e}", path.display()))
        })?;
        if manifest.chunk == 0 || manifest.runs == 0 {
            return Err(CampaignError::Input(format!(
                "{}: is not what fuyu wrote: runs and chunk are positive",
                path.display()
            )));
        }
        Ok(Self {
            folder: folder.to_owned(),
            manifest,
        })
    }

    /// The content of `campaign.json`.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The campaign as it was when it was started.
    ///
    /// # Errors
    /// [`CampaignError::Input`] if a file that it names has changed or is missing.
    pub fn campaign(&self) -> Result<Campaign, CampaignError> {
        let Manifest {
            campaign_path,
            campaign,
            scenario_path,
            scenario,
            runs,
            ..
        } = self.manifest.clone();
        let made = Campaign::new(campaign_path, campaign, scenario_path, scenario, Some(runs));
        let made = made.map_err(CampaignError::Input)?;
        let now = made.manifest().map_err(CampaignError::Input)?;
        match difference(&self.manifest, &now) {
            None => Ok(made),
            Some(what) => Err(CampaignError::Input(format!(
                "{}: was computed with another {what}",
                self.folder.display()
            ))),
        }
    }

    fn part(&self, kind: &str, chunk: u64) -> PathBuf {
        self.folder
            .join(kind)
            .join(format!("part-{chunk:06}.parquet"))
    }

    /// The runs of a table.
    pub(super) fn runs_of(&self, chunk: u64) -> RangeInclusive<u64> {
        let size = self.manifest.chunk;
        chunk * size..=((chunk + 1) * size).min(self.manifest.runs) - 1
    }

    /// Columns of the results.
    fn columns(&self) -> Vec<Column> {
        let column = |name: &str, kind| Column {
            name: name.to_owned(),
            kind,
        };
        let mut columns = vec![
            column("run", ColumnKind::Integer),
            column("seed", ColumnKind::Integer),
            column("verdict", ColumnKind::Text),
            column("reason", ColumnKind::Text),
        ];
        columns.extend(self.manifest.parameters.iter().cloned());
        columns.extend(self.manifest.results.iter().cloned());
        columns.push(column("version", ColumnKind::Text));
        columns
    }

    /// All rows so far, by ascending run.
    ///
    /// # Errors
    /// [`CampaignError::Runtime`] if a file cannot be read.
    pub fn rows(&self) -> Result<Vec<Row>, CampaignError> {
        let mut all = Vec::new();
        for chunk in 0..self.manifest.runs.div_ceil(self.manifest.chunk) {
            all.extend(self.rows_of(chunk)?.into_values());
        }
        Ok(all)
    }

    /// The rows of a table, complete or not.
    pub(super) fn rows_of(&self, chunk: u64) -> Result<BTreeMap<u64, Row>, CampaignError> {
        let mut rows = self.table_rows(chunk)?;
        for path in self.journals(chunk) {
            for row in read_journal(&path)?.0 {
                if self.runs_of(chunk).contains(&row.run) {
                    rows.entry(row.run).or_insert(row);
                }
            }
        }
        Ok(rows)
    }

    fn table_rows(&self, chunk: u64) -> Result<BTreeMap<u64, Row>, CampaignError> {
        let path = self.part("results", chunk);
        if !path.exists() {
            return Ok(BTreeMap::new());
        }
        let (names, cells) = table::read(&path).map_err(CampaignError::Runtime)?;
        let expected: Vec<_> = self.columns().into_iter().map(|c| c.name).collect();
        if names != expected {
            return Err(CampaignError::Runtime(format!(
                "{}: has other columns than campaign.json",
                path.display()
            )));
        }
        let times = self.part("wall_time", chunk);
        let mut wall_times = BTreeMap::new();
        if times.exists() {
            for row in table::read(&times).map_err(CampaignError::Runtime)?.1 {
                if let [Cell::Integer(run), Cell::Number(time)] = row.as_slice() {
                    wall_times.insert(*run, *time);
                }
            }
        }
        let rows = cells.into_iter().map(|cells| {
            self.row_of(cells, &wall_times).ok_or_else(|| {
                CampaignError::Runtime(format!(
                    "{}: has a row without run or verdict",
                    path.display()
                ))
            })
        });
        rows.map(|row| row.map(|row| (row.run, row))).collect()
    }

    fn row_of(&self, cells: Vec<Cell>, wall_times: &BTreeMap<i64, f64>) -> Option<Row> {
        let [
            Cell::Integer(run),
            Cell::Integer(seed),
            Cell::Text(verdict),
            reason,
            values @ ..,
            _,
        ] = cells.as_slice()
        else {
            return None;
        };
        let (parameters, results) = values.split_at_checked(self.manifest.parameters.len())?;
        Some(Row {
            run: u64::try_from(*run).ok()?,
            seed: u64::try_from(*seed).ok()?,
            verdict: Verdict::ALL.into_iter().find(|v| v.name() == verdict)?,
            reason: match reason {
                Cell::Text(text) => Some(text.clone()),
                _ => None,
            },
            parameters: parameters.to_vec(),
            results: results.to_vec(),
            wall_time: wall_times.get(run).copied().unwrap_or(f64::NAN),
        })
    }

    /// Journals of a table, sorted by name.
    fn journals(&self, chunk: u64) -> Vec<PathBuf> {
        let prefix = format!("part-{chunk:06}.");
        let Ok(entries) = fs::read_dir(self.folder.join("journal")) else {
            return Vec::new();
        };
        let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let mut names: Vec<_> = names
            .filter(|n| n.starts_with(&prefix) && n.ends_with(".jsonl"))
            .collect();
        names.sort();
        names
            .iter()
            .map(|name| self.folder.join("journal").join(name))
            .collect()
    }

    /// Removes partial tables left by killed processes.
    pub(super) fn remove_drafts(&self) {
        for kind in ["results", "wall_time", "series"] {
            let Ok(entries) = fs::read_dir(self.folder.join(kind)) else {
                continue;
            };
            for entry in entries.filter_map(Result::ok) {
                if entry.file_name().to_string_lossy().starts_with('.') {
                    // Readers ignore hidden files, so a remaining one does no harm.
                    let _ = fs::remove_file(entry.path());
                }
            }
        }
    }

    /// Writes the table of a chunk from its journals, if all of its runs are done. Returns the runs that are done.
    pub(super) fn complete(&self, chunk: u64) -> Result<BTreeSet<u64>, CampaignError> {
        // Locked: another process, whose campaign has more runs, must not write its table between reading and writing
        // here. Not every file system supports locks.
        let lock = File::create(self.folder.join("journal").join("tables.lock"));
        let _lock = lock.and_then(|file| file.lock().map(|()| file));
        let all_are_in =
            |rows: &BTreeMap<u64, Row>| self.runs_of(chunk).all(|run| rows.contains_key(&run));
        let journals = self.journals(chunk);
        let mut rows = self.table_rows(chunk)?;
        if !all_are_in(&rows) {
            rows = self.rows_of(chunk)?;
            if !all_are_in(&rows) {
                return Ok(rows.into_keys().collect());
            }
            let times = rows
                .values()
                .map(|row| vec![Cell::Integer(row.run as i64), Cell::Number(row.wall_time)]);
            let columns = [
                Column {
                    name: "run".to_owned(),
                    kind: ColumnKind::Integer,
                },
                Column {
                    name: "wall_time".to_owned(),
                    kind: ColumnKind::Number,
                },
            ];
            table::write(
                &self.part("wall_time", chunk),
                &columns,
                &times.collect::<Vec<_>>(),
            )
            .map_err(CampaignError::Runtime)?;
            let cells = rows.values().map(|row| {
                let mut cells = vec![
                    Cell::Integer(row.run as i64),
                    Cell::Integer(row.seed as i64),
                    Cell::Text(row.verdict.name().to_owned()),
                    row.reason.clone().map_or(Cell::Null, Cell::Text),
                ];
                cells.extend(row.parameters.iter().cloned());
                cells.extend(row.results.iter().cloned());
                cells.push(Cell::Text(self.manifest.version.clone()));
                cells
            });
            table::write(
                &self.part("results", chunk),
                &self.columns(),
                &cells.collect::<Vec<_>>(),
            )
            .map_err(CampaignError::Runtime)?;
        }
        for journal in journals {
            // A journal of a process with more runs may have further rows.
            let (journaled, _) = read_journal(&journal)?;
            if journaled.iter().all(|row| rows.contains_key(&row.run)) {
                // Another process may have removed it already.
                let _ = fs::remove_file(journal);
            }
        }
        Ok(rows.into_keys().collect())
    }
}

/// The first difference between two campaigns, apart from the number of runs.
fn difference(a: &Manifest, b: &Manifest) -> Option<&'static str> {
    if a.version != b.version {
        Some("version of fuyu")
    } else if a.campaign != b.campaign {
        Some("text")
    } else if a.scenario != b.scenario {
        Some("scenario")
    } else if a.descriptions != b.descriptions {
        Some("description of robot or target")
    } else if a.chunk != b.chunk || a.parameters != b.parameters || a.results != b.results {
        Some("set of columns")
    } else {
        None
    }
}

/// The complete rows of a journal, and their length in bytes. A line truncated by a kill or a full disk is not a row.
pub(super) fn read_journal(path: &Path) -> Result<(Vec<Row>, u64), CampaignError> {
    let mut text = Vec::new();
    match File::open(path).and_then(|mut file| file.read_to_end(&mut text)) {
        Ok(_) => {}
        // Another process has completed the table and removed the journal.
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok((Vec::new(), 0)),
        Err(e) => {
            let text = format!("{}: cannot be read: {e}", path.display());
            return Err(CampaignError::Runtime(text));
        }
    }
    let (mut rows, mut length) = (Vec::new(), 0);
    for line in text.split_inclusive(|byte| *byte == b'\n') {
        if !line.ends_with(b"\n") {
            break;
        }
        let Ok(row) = serde_json::from_slice(line) else {
            break;
        };
        rows.push(row);
        length += line.len() as u64;
    }
    Ok((rows, length))
}
