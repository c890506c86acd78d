//! Work that one thread does in order behind its owner, who goes on meanwhile.
//!
//! For writing: the owner fills the next buffer while the system copies the last one. Nothing but the time depends on it.

use crate::error::{Error, Result};
use crate::parallel::guarded;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A piece of work, or the question whether all before it is done.
enum Message<J> {
    Work(J),
    Ask(Sender<()>),
}

/// One thread at work behind its owner.
#[derive(Debug)]
pub struct Worker<J> {
    queue: Option<SyncSender<Message<J>>>,
    /// The first failure, until the owner takes it.
    failed: Arc<Mutex<Option<Error>>>,
    worker: Option<JoinHandle<()>>,
}

impl<J: Send + 'static> Worker<J> {
    /// Starts a thread that does `work` with one piece after the other; one more may wait. `None` without a thread.
    pub fn start(work: impl FnMut(J) -> Result<()> + Send + 'static) -> Option<Self> {
        let (queue, pieces) = sync_channel(1);
        let failed = Arc::new(Mutex::new(None));
        let notes = failed.clone();
        let worker =
            std::thread::Builder::new().spawn(move || work_through(&pieces, &notes, work)).ok()?;
        Some(Worker { queue: Some(queue), failed, worker: Some(worker) })
    }

    /// Hands a piece over; waits while another one waits already.
    ///
    /// Errors: the first failure so far. After a failure nothing more is done.
    pub fn give(&self, piece: J) -> Result<()> {
        self.send(Message::Work(piece))?;
        self.take_failure()
    }

    /// Waits until all pieces are done. Errors: as `give`.
    pub fn wait(&self) -> Result<()> {
        let (answer, answered) = channel();
        self.send(Message::Ask(answer))?;
        answered.recv().map_err(|_| ended())?;
        self.take_failure()
    }

    fn send(&self, message: Message<J>) -> Result<()> {
        self.queue.as_ref().and_then(|queue| queue.send(message).ok()).ok_or_else(ended)
    }

    fn take_failure(&self) -> Result<()> {
        let failure = self.failed.lock().unwrap_or_else(PoisonError::into_inner).take();
        failure.map_or(Ok(()), Err)
    }
}

impl<J> Drop for Worker<J> {
    /// Lets the thread end what it was given.
    fn drop(&mut self) {
        drop(self.queue.take());
        if let Some(worker) = self.worker.take() {
            // A panic in the work is a failure that was noted.
            let _ = worker.join();
        }
    }
}

fn work_through<J>(
    pieces: &Receiver<Message<J>>,
    failed: &Mutex<Option<Error>>,
    mut work: impl FnMut(J) -> Result<()>,
) {
    let mut is_broken = false;
    while let Ok(message) = pieces.recv() {
        match message {
            Message::Ask(answer) => {
                // The owner may have gone meanwhile.
                let _ = answer.send(());
            }
            Message::Work(piece) if !is_broken => {
                if let Err(error) = guarded(|| work(piece)) {
                    is_broken = true;
                    *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                }
            }
            Message::Work(_) => {}
        }
    }
}

fn ended() -> Error {
    Error::Internal("the thread that writes has ended".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_done_in_order_and_all_of_them_before_the_end() {
        let done = Arc::new(Mutex::new(Vec::new()));
        let list = done.clone();
        let behind = Worker::start(move |piece: u32| {
            list.lock().unwrap().push(piece);
            Ok(())
        })
        .unwrap();
        (0..50).for_each(|piece| behind.give(piece).unwrap());
        behind.wait().unwrap();
        assert_eq!(*done.lock().unwrap(), (0..50).collect::<Vec<_>>());
        (50..53).for_each(|piece| behind.give(piece).unwrap());
        drop(behind);
        assert_eq!(done.lock().unwrap().len(), 53);
    }

    #[test]
    fn the_first_failure_comes_back_and_nothing_follows_it() {
        let done = Arc::new(Mutex::new(0));
        let count = done.clone();
        let behind = Worker::start(move |piece: u32| {
            assert!(piece != 9, "nine falls");
            *count.lock().unwrap() += 1;
            if piece == 3 { Err(Error::Usage("three".to_owned())) } else { Ok(()) }
        })
        .unwrap();
        let outcomes: Vec<_> = (0..20).map(|piece| behind.give(piece)).collect();
        let last = behind.wait();
        let errors: Vec<String> = outcomes
            .into_iter()
            .chain([last])
            .filter_map(|o| o.err())
            .map(|e| e.to_string())
            .collect();
        assert_eq!(errors, ["three"]);
        assert_eq!(*done.lock().unwrap(), 4);
    }
}
