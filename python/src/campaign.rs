//! `CampaignFile`, of which `fuyu/campaign.py` makes a `Campaign`.

use std::ffi::OsString;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use fuyu::experiments::campaign::{
    self, CampaignError, Cell, Column, Dataset, Progress, RangeOptions, Row, Summary, Workers,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{input, run};

fn error(problem: CampaignError) -> PyErr {
    match problem {
        CampaignError::Input(text) => input(text),
        CampaignError::Runtime(text) => run(text),
    }
}

/// A campaign's file, ready to run.
#[pyclass(frozen, module = "fuyu._fuyu")]
pub struct CampaignFile {
    campaign: campaign::Campaign,
}

#[pymethods]
impl CampaignFile {
    #[new]
    #[pyo3(signature = (source, runs = None))]
    fn new(source: &Bound<'_, PyAny>, runs: Option<u64>) -> PyResult<Self> {
        let source: String = source.str()?.extract()?;
        let campaign = campaign::Campaign::load(&source, runs).map_err(error)?;
        Ok(Self { campaign })
    }

    /// Name of the campaign.
    #[getter]
    fn name(&self) -> String {
        self.campaign.name()
    }

    /// The file; `package://fuyu/PATH` if it comes with the package.
    #[getter]
    fn path(&self) -> String {
        self.campaign.path().display().to_string()
    }

    /// Number of runs.
    #[getter]
    fn runs(&self) -> u64 {
        self.campaign.runs()
    }

    /// The campaign's seed.
    #[getter]
    fn seed(&self) -> u64 {
        self.campaign.seed()
    }

    /// Names of the dispersed parameters.
    #[getter]
    fn parameters(&self) -> Vec<String> {
        names(self.campaign.parameters())
    }

    /// Names of the kept results.
    #[getter]
    fn results(&self) -> Vec<String> {
        names(self.campaign.results())
    }

    /// The criteria of success.
    #[getter]
    fn criteria(&self) -> Vec<String> {
        let criteria = self.campaign.criteria().iter();
        criteria.map(|c| c.text().to_owned()).collect()
    }

    /// The dispersed parameters of a run, by name.
    fn parameters_of<'py>(&self, py: Python<'py>, run: i64) -> PyResult<Bound<'py, PyDict>> {
        let values = PyDict::new(py);
        let cells = self.campaign.parameters_of(self.number(run)?);
        fill(&values, self.campaign.parameters(), &cells)?;
        Ok(values)
    }

    /// The scenario of a run as a parameter file.
    fn scenario_text(&self, run: i64) -> PyResult<String> {
        let number = self.number(run)?;
        self.campaign.scenario_text_of(number).map_err(error)
    }

    /// Computes one run: its row of the dataset, with its wall time. Series and bags go to `folder`, if there is one.
    #[pyo3(signature = (run, folder = None))]
    fn run_one<'py>(
        &self,
        py: Python<'py>,
        run: i64,
        folder: Option<PathBuf>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let number = self.number(run)?;
        let row = py.detach(|| self.campaign.run_one(number, folder.as_deref()));
        self.row(py, &row.map_err(error)?)
    }

    /// Creates the dataset, or checks that it is this campaign's.
    fn create(&self, folder: PathBuf) -> PyResult<()> {
        Dataset::create(&self.campaign, &folder)
            .map(|_| ())
            .map_err(error)
    }

    /// Computes the runs `first` to `last` in processes of `command`, and returns how many of them are done. Ends early, also during
    /// runs, when a signal is pending or `progress(done, total)`, which is called after each run, raises, with that exception.
    #[pyo3(signature = (folder, first, last, *, jobs, command, progress = None))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn run_range(
        &self,
        py: Python<'_>,
        folder: PathBuf,
        first: i64,
        last: i64,
        jobs: usize,
        command: Vec<OsString>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<u64> {
        let (first, last) = (self.number(first)?, self.number(last)?);
        let dataset = Dataset::create(&self.campaign, &folder).map_err(error)?;
        let options = RangeOptions {
            jobs,
            workers: Workers::Processes(command),
        };
        let (mut raised, mut reported) = (None, None);
        let reached = py.detach(|| {
            let report = |now: Progress| {
                let is_new = reported.replace(now) != Some(now);
                let called = Python::attach(|py| {
                    py.check_signals()?;
                    match &progress {
                        Some(call) if is_new => call.call1(py, (now.done, now.total)).map(|_| ()),
                        _ => Ok(()),
                    }
                });
                match called {
                    Ok(()) => ControlFlow::Continue(()),
                    Err(e) => {
                        raised = Some(e);
                        ControlFlow::Break(())
                    }
                }
            };
            campaign::run_range(&self.campaign, &dataset, first..=last, &options, report)
        });
        // Ctrl-C also ends processes that are just starting, which is not what went wrong.
        match raised.or_else(|| py.check_signals().err()) {
            Some(e) => Err(e),
            None => Ok(reached.map_err(error)?.done),
        }
    }
}

impl CampaignFile {
    /// The number of a run that exists.
    fn number(&self, run: i64) -> PyResult<u64> {
        let runs = self.campaign.runs();
        let number = u64::try_from(run).ok().filter(|run| *run < runs);
        number.ok_or_else(|| {
            input(format!(
                "run {run}: the campaign has runs 0 to {}",
                runs - 1
            ))
        })
    }

    /// As in the dataset, with the wall time.
    fn row<'py>(&self, py: Python<'py>, row: &Row) -> PyResult<Bound<'py, PyDict>> {
        let values = PyDict::new(py);
        values.set_item("run", row.run)?;
        values.set_item("seed", row.seed)?;
        values.set_item("verdict", row.verdict.name())?;
        values.set_item("reason", &row.reason)?;
        fill(&values, self.campaign.parameters(), &row.parameters)?;
        fill(&values, self.campaign.results(), &row.results)?;
        values.set_item("wall_time", row.wall_time)?;
        Ok(values)
    }
}

fn names(columns: &[Column]) -> Vec<String> {
    columns.iter().map(|column| column.name.clone()).collect()
}

fn fill(values: &Bound<'_, PyDict>, columns: &[Column], cells: &[Cell]) -> PyResult<()> {
    for (column, cell) in columns.iter().zip(cells) {
        match cell {
            Cell::Null => values.set_item(&column.name, values.py().None())?,
            Cell::Number(x) => values.set_item(&column.name, x)?,
            Cell::Integer(i) => values.set_item(&column.name, i)?,
            Cell::Bool(b) => values.set_item(&column.name, b)?,
            Cell::Text(text) => values.set_item(&column.name, text)?,
        }
    }
    Ok(())
}

/// Statistics of the runs in `folder` as a JSON text.
#[pyfunction]
pub fn campaign_summary(py: Python<'_>, folder: PathBuf, confidence: f64) -> PyResult<String> {
    if !(confidence > 0.0 && confidence < 1.0) {
        return Err(input(format!(
            "confidence is {confidence}; it must be between 0 and 1"
        )));
    }
    let summary = py.detach(|| Summary::of(&Dataset::open(&folder)?, confidence));
    serde_json::to_string(&summary.map_err(error)?).map_err(run)
}

/// Draws pictures into `folder`/plots; returns their paths.
#[pyfunction]
pub fn campaign_plots(py: Python<'_>, folder: PathBuf) -> PyResult<Vec<PathBuf>> {
    let plot = |folder: &Path| {
        let dataset = Dataset::open(folder)?;
        let summary = Summary::of(&dataset, 0.95)?;
        campaign::plot(&dataset, &summary, &folder.join("plots"))
    };
    py.detach(|| plot(&folder)).map_err(error)
}

/// Serves a process that computes the campaign in `folder`: numbers of runs on stdin, rows on stdout.
#[pyfunction]
pub fn campaign_worker(py: Python<'_>, folder: PathBuf) -> PyResult<()> {
    py.detach(|| campaign::serve_worker(&folder)).map_err(error)
}
