"""Logs in, signal processing, samples out."""

from steelyard.recording.chunks import Chunk as Chunk
from steelyard.recording.chunks import process_chunks as process_chunks
from steelyard.recording.chunks import read_chunks as read_chunks
from steelyard.recording.columns import LogColumns as LogColumns
from steelyard.recording.processing import Processing as Processing
from steelyard.recording.recording import Recording as Recording
from steelyard.recording.samples import Samples as Samples

__all__ = ["Chunk", "LogColumns", "Processing", "Recording", "Samples", "process_chunks", "read_chunks"]
