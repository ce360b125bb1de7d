from .settings import CaptureSettings as CaptureSettings
