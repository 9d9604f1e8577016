"""The module `vision_definitions` of Python scripts: constants of ALVideoDevice."""

kTopCamera, kBottomCamera, kDepthCamera, kStereoCamera, kStereoCameraID = 0, 1, 2, 3, 3

kQQVGA, kQVGA, kVGA, k4VGA, k960p = 0, 1, 2, 3, 3
kQQQVGA, kQQQQVGA = 7, 8

kYuvColorSpace, kyUvColorSpace, kyuVColorSpace = 0, 1, 2
kRgbColorSpace, krGbColorSpace, krgBColorSpace = 3, 4, 5
kHsyColorSpace, khSyColorSpace, khsYColorSpace = 6, 7, 8
kYUV422ColorSpace, kYUV422InterlacedColorSpace = 9, 9
kYUVColorSpace, kRGBColorSpace, kHSYColorSpace, kBGRColorSpace = 10, 11, 12, 13
kYYCbCrColorSpace, kH2RGBColorSpace, kHSMixedColorSpace = 14, 15, 16
kDepthColorSpace, kXYZColorSpace, kDistanceColorSpace, kRawDepthColorSpace = 17, 19, 21, 23

kCameraBrightnessID, kCameraContrastID, kCameraSaturationID, kCameraHueID = 0, 1, 2, 3
kCameraRedChromaID, kCameraBlueChromaID, kCameraGainID = 4, 5, 6
kCameraHFlipID, kCameraVFlipID, kCameraLensXID, kCameraLensYID = 7, 8, 9, 10
kCameraAutoExpositionID, kCameraAutoWhiteBalanceID, kCameraAutoGainID = 11, 12, 13
kCameraResolutionID, kCameraFrameRateID, kCameraBufferSizeID = 14, 15, 16
kCameraExposureID, kCameraSelectID, kCameraSetDefaultParamsID = 17, 18, 19
kCameraColorSpaceID, kCameraExposureCorrectionID = 20, 21
kCameraAecAlgorithmID, kCameraSharpnessID, kCameraWhiteBalanceID = 22, 24, 33
kCameraFastSwitchID, kCameraBacklightCompensationID = 35, 34
