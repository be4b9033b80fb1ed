"""Label lists as laboratories write them, by marker set and variant, with what they cover."""

from support.recordings.label_lists_further import FURTHER

LEGS, LEGS_AND_TRUNK, BODY = "trunk-missing", "arms-missing", ""
"""What a list covers: the code of the largest substitute that it needs."""

LISTS = {
    **FURTHER,
    "helen-hayes": (
        BODY,
        """
        THEA FHEA RHEA RSHO ROFF RELB RWRI LSHO LELB LWRI RASI LASI VSAC RTHI RKNE RSHA RANK RHEE R.TO LTHI
        LKNE LSHA LANK LHEE L.TO VMID VPEL VRHI VLHI VRKN VLKN VRAN VLAN
        """,
    ),
    "helen-hayes written out": (
        BODY,
        """
        R.Shoulder R.Scapula L.Shoulder R.ASIS V.Sacral L.ASIS R.Elbow R.Wrist L.Elbow L.Wrist R.Thigh
        R.Knee R.Shank R.Ankle R.Heel R.Toe L.Thigh L.Knee L.Shank L.Ankle L.Heel L.Toe
        """,
    ),
    "visual3d-hybrid": (
        LEGS,
        """
        R_ASIS L_ASIS SACRUM R_THIGH_1 R_THIGH_2 R_THIGH_3 R_THIGH_4 L_THIGH_1 L_THIGH_2 L_THIGH_3 L_THIGH_4 R_SHANK_1
        R_SHANK_2 R_SHANK_3 L_SHANK_1 L_SHANK_2 L_SHANK_3 R_HEEL R_MT_1 R_MT_5 L_HEEL L_MT_1 L_MT_5
        """,
    ),
    "visual3d-knee-line": (
        LEGS_AND_TRUNK,
        """
        r_shoulder th12 r_asis r_suppat r_knjntln r_tubtib r_ankle r_heel r_toe l_shoulder sacrum l_asis
        l_suppat l_knjntln l_tubtib l_ankle l_heel l_toe
        """,
    ),
    "davis-lower": (
        LEGS_AND_TRUNK,
        """
        r~should r~asis r~thigh r~bar~1 r~knee~1 r~knee~2 r~bar~2 r~mall r~met l~should l~asis l~thigh
        l~bar~1 l~knee~1 l~knee~2 l~bar~2 l~mall l~met c7 sacrum
        """,
    ),
    "codamotion": (
        LEGS,
        """
        L.Sac.Wand R.Sac.Wand L.PSIS L.ASIS L.Post.Fem. L.Ant.Fem. L.Post.Tib. L.Ant.Tib. L.Knee L.Ankle
        L.Heel L.Toe R.PSIS R.ASIS R.Post.Fem. R.Ant.Fem. R.Post.Tib. R.Ant.Tib. R.Knee R.Ankle R.Heel R.Toe
        """,
    ),
    "melbourne": (
        BODY,
        """
        C7 RSH LSH MAN T7 LARM LELB LFOREARM LWR RARM RELB RFOREARM RWR RASI LASI SACR P1 P2 P3 LTHLP LTHLD
        LTHAP LTHAD LLEPI LPAT LTIAP LTIAD LTILAT LLMAL LHEEL LMFS LMFL LP1MT LTOE LP5MT RTHLP RTHLD RTHAP
        RTHAD RLEPI RPAT RTIAP RTIAD RTILAT RLMAL RHEEL RMFS RMFL RP1MT RTOE RP5MT
        """,
    ),
    "cmu": (
        BODY,
        """
        RFHD LFHD LBHD RBHD C7 T10 CLAV STRN RBAC LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA RWRB RFIN
        LFWT RFWT LBWT RBWT LTHI LKNE LSHN LANK LHEE LTOE LMT5 RTHI RKNE RSHN RANK RHEE RTOE RMT5
        """,
    ),
    "ariel": (
        BODY,
        """
        ARIEL LFHD LBHD RFHD RBHD C7 T10 CLAV STRN LFSH LBSH LUPA LELB LIEL LOWR LIWR LWRE LIHAND LOHAND
        RFSH RBSH RUPA RELB RIEL ROWR RIWR RWRE RIHAND ROHAND LFWT LMWT LBWT RFWT RMWT RBWT LHIP LKNE LKNI
        LSHN LANK LHEL LMT5 LMT1 LTOE RHIP RKNE RKNI RSHN RANK RHEL RMT5 RMT1 RTOE
        """,
    ),
    "isb-trunk": (
        LEGS_AND_TRUNK,
        """
        LFCC LFM5 LFM2 RFCC RFM5 RFM2 LTAM LFAL LSK LTT RTAM RFAL RSK RTT LFME LFLE LTH LFT RFME RFLE RTH
        RFT LIPS RIPS LIAS RIAS MAI SXS SJN CV7 LAC RAC
        """,
    ),
    "gait2354": (
        LEGS,
        """
        L_ASIS L_Ankle_Lat L_Heel L_Knee_Lat L_PSIS L_Shank_Front L_Shank_Rear L_Shank_Upper L_Thigh_Front L_Thigh_Rear
        L_Thigh_Upper L_Toe_Lat L_Toe_Med L_Toe_Tip R_ASIS R_Ankle_Lat R_Heel R_Knee_Lat R_PSIS R_Shank_Front
        R_Shank_Rear R_Shank_Upper R_Thigh_Front R_Thigh_Rear R_Thigh_Upper R_Toe_Lat R_Toe_Med
        """,
    ),
    "cast": (
        BODY,
        """
        GLAB RFHD LFHD C7 T6 T12 LASI RASI LPSI RPSI LTHOL LTH2 LTH3 LKNEL LKNEM LFIB LSHAOL LSHA2 LSHA3
        LMALL LMALM LHEE LTOE LM5 RTHOL RTH2 RTH3 RKNEL RKNEM RFIB RSHAOL RSHA2 RSHA3 RMALL RMALM RHEE RTOE
        RM5 STRN XIPH LACR LUAOL LCUBL LCUBM LLAOL LWRR LWRU RACR RUAOL RCUBL RCUBM RLAOL RWRR RWRU
        """,
    ),
    "motek-hbm": (
        BODY,
        """
        LHEAD THEAD RHEAD FHEAD C7 T10 SACR NAVE XYPH STRN BBAC LSHO LDELT LLEE LMEE LFRM LMW LLW LFIN RSHO
        RDELT RLEE RMEE RFRM RMW RLW RFIN LASIS RASIS LPSIS RPSIS LGTRO FLTHI LLEK LATI LLM LHEE LTOE LMT5
        RGTRO FRTHI RLEK RATI RLM RHEE RTOE RMT5
        """,
    ),
    "motek-hbm2": (
        LEGS_AND_TRUNK,
        """
        LASIS RASIS LPSIS RPSIS LLTHI LLEK LMEK LLSHA LLM LMM LHEE LMT2 LMT5 RLTHI RLEK RMEK RLSHA RLM RMM RHEE
        RMT2 RMT5 C7 T10 XIPH JN
        """,
    ),
    "motek-hbm2 with arms": (
        BODY,
        """
        LMAS RMAS GLAB C7 T10 JN XIPH RBAK LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA RWRB RFIN
        LASIS RASIS LPSIS RPSIS LTHI LLTHI LTHAD LLEK LMEK LTIB LLSHA LTIAD LLM LMM LHEE LTOE LMT2 LSMH LMT5
        RTHI RLTHI RTHAD RLEK RMEK RTIB RLSHA RTIAD RLM RMM RHEE RTOE RMT2 RSMH RMT5
        """,
    ),
    "isb-trunk head": (
        LEGS_AND_TRUNK,
        """
        L_IAS L_IPS R_IPS R_IAS L_FTC L_FLE L_FME L_FAX L_TTC L_FAL L_TAM L_FCC L_FM1 L_FM2 L_FM5 R_FTC R_FLE
        R_FME R_FAX R_TTC R_FAL R_TAM R_FCC R_FM1 R_FM2 R_FM5 L_SAE CV7 R_SAE R_HDF R_HDB L_HDB L_HDF
        """,
    ),
    "bmclab-running": (
        LEGS,
        """
        L.ASIS L.Heel.Bottom L.Heel.Lateral L.Heel.Top L.Iliac.Crest L.MT1 L.MT5 L.PSIS L.Shank.Bottom.Lateral
        L.Shank.Bottom.Medial L.Shank.Top.Lateral L.Shank.Top.Medial L.Thigh.Bottom.Lateral L.Thigh.Bottom.Medial
        L.Thigh.Top.Lateral L.Thigh.Top.Medial R.ASIS R.Heel.Bottom R.Heel.Lateral R.Heel.Top R.Iliac.Crest R.MT1
        R.MT5 R.PSIS R.Shank.Bottom.Lateral R.Shank.Bottom.Medial R.Shank.Top.Lateral R.Shank.Top.Medial
        R.Thigh.Bottom.Lateral R.Thigh.Bottom.Medial R.Thigh.Top.Lateral R.Thigh.Top.Medial
        """,
    ),
    "knee-lat-toe-tip": (
        LEGS_AND_TRUNK,
        """
        RAcromium LAcromium C7 Clavicle VSacral RASIS LASIS RHip LHip RKneeLat RKneeMed LKneeMed LKneeLat LShankFront
        RShankFront RAnkleLat RAnkleMed LAnkleMed LAnkleLat LToeLat LToeTip RToeTip RToeLat RHeel LHeel T10
        """,
    ),
    "back-asis": (
        BODY,
        """
        LHeadTamp LHeadBack RHeadBack RHeadTamp C7 Clav Sternum T10 LASIS LBackAsis RBackAsis RASIS LAcromium LArm
        LElbowLat LForearm LWristLat LWristMed LFinger RAcromium RArm RElbowLat RForearm RWristLat RWristMed RFinger
        LThighUpperC LThighFrontC LThighRearC LThighDownC LKneeLat LShankUpperC LShankFrontC LShankDownC LAnkleLat
        LHeel LCalcExt LCalcInt LMT5 LPHAL5 LPHAL2 LPHAL1 LMT1 LMidFoot LForeFoot RThighUpperC RThighFrontC
        RThighRearC RThighDownC RKneeLat RShankUpperC RShankFrontC RShankDownC RAnkleLat RHeel RCalcExt RCalcInt
        RMT5 RPHAL5 RPHAL2 RPHAL1 RMT1 RMidFoot RForeFoot
        """,
    ),
    "pig-joints": (LEGS, "MIDPEL LFEP LFEO LTIO LTOE RFEP RFEO RTIO RTOE qRPVX qRPVY qRPVZ"),
    "lkn-clusters": (
        LEGS_AND_TRUNK,
        """
        LASI RASI LPSI RPSI LSHL CLAV RSHL C7 LTH1 LTH2 LTH3 LTH4 LSH1 LSH2 LSH3 LSH4 LTOE LMT5 LCAL LCUN
        RTH1 RTH2 RTH3 RTH4 RSH1 RSH2 RSH3 RSH4 RTOE RMT5 RCAL RCUN
        """,
    ),
    "lamb": (
        BODY,
        """
        RxCheec LxCheec C7 maxkif RxShould LxShould RxElbow LxElbow RxWrist LxWrist Psis RxAsis LxAsis RxThigh LxThigh
        RxLatCon LxLatCon RxFH LxFH RxShank LxShank RxLatMal LxLatMal RxHeel LxHeel RxToe1 LxToe1 RxMeta5 LxMeta5
        """,
    ),
    "innsport": (
        LEGS,
        """
        ROFF RASI LASI VSAC RPSI LPSI RGRT RTHI RLFC RTTB RSHA RLMA RPM1 RCAL RTOE LGRT LTHI LLFC LTTB LSHA
        LLMA LPM1 LCAL LTOE
        """,
    ),
    "inria": (
        BODY,
        """
        RTET LTET C7 STER PX T8 RACR LACR RPRO LPRO RCOU LCOU RMAI LMAI RMC5 LMC5 RMC2 LMC2 REAS LEAS REPS
        LEPS RCM LCM RCL LCL RMM LMM RML LML RCAL LCAL RMT1 LMT1 RMT5 LMT5 RHAL LHAL
        """,
    ),
    "ensam": (
        BODY,
        """
        OCCD TMPD C7 MAN XYP T8 T12 EASG MTBassin EPSG EPSD EASD FHAG FHPG FBPG FBAG CLG CMG TFIBG THAG THPG
        TBPG TBAG MLG MMG MT5G MT1G MTPG CALG FHAD FHPD FBPD FBAD CLD CMD TFIBD THAD THPD TBPD TBAD MLD MMD
        MT5D MT1D MTPD CALD CLAVG ACG ELG EMG MTRG PSRG PSUG MC2G MC5G CLAVD ACD ELD EMD MTRD PSRD PSUD MC2D
        MC5D TMPG OCCG MTTETE
        """,
    ),
    "xsens-mvn": (
        BODY,
        """
        pRightASI pLeftASI pSacrum pT12SpinalProcess pPX pIJ pC7SpinalProcess pTopOfHead pRightAcromion
        pLeftAcromion pRightArmLatEpicondyle pRightArmMedEpicondyle pLeftArmLatEpicondyle
        pLeftArmMedEpicondyle pRightUlnarStyloid pRightRadialStyloid pLeftUlnarStyloid pLeftRadialStyloid
        pRightGreaterTrochanter pRightKneeLatEpicondyle pRightKneeMedEpicondyle pLeftGreaterTrochanter
        pLeftKneeLatEpicondyle pLeftKneeMedEpicondyle pRightLatMalleolus pRightMedMalleolus
        pLeftLatMalleolus pLeftMedMalleolus pRightHeelFoot pRightFirstMetatarsal pRightFifthMetatarsal
        pRightToe pLeftHeelFoot pLeftFirstMetatarsal pLeftFifthMetatarsal pLeftToe
        """,
    ),
    "ior": (
        LEGS_AND_TRUNK,
        """
        C7 CLAV LA RA T10 LASIS RASIS LPSIS RPSIS LT1 LT2 LT3 LT4 LS1 LS2 LS3 LS4 RT1 RT2 RT3 RT4 RS1 RS2
        RS3 RS4 LCA RCA LLE LME RLE RME LMM LLM RLM RMM RIMH LIMH RVMH LVMH
        """,
    ),
    "ior dynamic": (
        LEGS_AND_TRUNK,
        """
        C7 RA LA L5 RPSIS LPSIS RASIS LASIS RGT LGT RCA LCA RVMH LVMH RIMH LIMH RIIT LIIT CR1 CR4 CR2 CR3
        GR1 GR4 GR2 GR3 CL1 CL2 CL4 CL3 GL1 GL2 GL4 GL3
        """,
    ),
    "uwa-full": (
        BODY,
        """
        C7 RACR LPSI RPSH LUA1 LFA1 RUA3 LACR LUA3 LTH3 RUA1 LTB2 LASH LMT5 LUA2 LTH1 LMT1 SACR LFA2 LTB1
        LCAL RCAL LTB3 RFA2 RFA3 RTH2 STRN RTH3 LPSH RASH RHNU CLAV RFA1 RASI LFA3 RHNR LASI RTH1 RMT1 RTB2
        RCAR RMT5 LCAR RTB1 RUA2 RTB3 LTH2 LHNU RPSI T10 LHNR RLEL RMEL LLEL LMEL
        """,
    ),
    "cleveland": (
        BODY,
        """
        R.Shoulder Sternum L.Shoulder R.Elbow R.Wrist L.Elbow L.Wrist R.ASIS Sacrum OFFSET L.ASIS R.Hip
        R.Thigh R.Knee R.TibTubercle R.MidShank R.DistalShank R.Heel R.Toe R.LateralFoot L.Hip L.Thigh
        L.Knee L.TibTubercle L.MidShank L.DistalShank L.Heel L.Toe L.LateralFoot R.MedialKnee R.Ankle
        R.MedialAnkle L.MedialKnee L.Ankle
        """,
    ),
    "kneel-ankl": (
        LEGS,
        """
        Sacr Lasi Rasi RTro RKneL RKneM RPat RTub RTib RAnkL RAnkM RHee RToeL RToeM RToe2 LTro LKneL LKneM
        LPat LTub LTib LAnkL LAnkM LHee LToeL LToeM LToe2
        """,
    ),
    "lkn-rtrc": (
        LEGS,
        """
        RASI LASI RTRC LTRC RLKN LLKN RTIB LTIB RANK LANK RHEE LHEE RTOE LTOE SACR LMKN RMKN LTUB RTUB LLMA
        RLMA
        """,
    ),
    "elbow-clusters": (
        BODY,
        """
        RASI LASI RPSI LPSI RFLE RFME RFAL RTAM RFM2 RFM5 RHEL LFLE LFME LFAL LTAM LFM2 LHEL LFM5 RSHO LSHO
        C7 RUP1 RELL RELM RFR1 RWRL RWRM LUP1 LELL LELM LFR1 LWRL LWRM RGT RTHI1 RTHI2 RTHI3 LGT LTHI2 LTHI3
        RSK1 LSK1 RILC
        """,
    ),
    "opencap-lab": (
        LEGS_AND_TRUNK,
        """
        r_knee r_ankle r_calc r_5meta r_toe L_knee L_ankle L_calc L_5meta L_toe r_mknee r_mankle L_mknee
        L_mankle r.ASIS r.PSIS L.ASIS L.PSIS C7 R_Shoulder L_Shoulder R_Sternum L_Sternum R_HJC L_HJC
        """,
    ),
    "rajagopal": (
        BODY,
        """
        R.Shoulder R.Clavicle R.Bicep R.Elbow R.Forearm R.Wrist L.Shoulder L.Clavicle L.Bicep L.Elbow
        L.Forearm L.Wrist R.ASIS R.PSIS S2 L.PSIS L.ASIS R.TH1 R.TH2 R.TH3 R.Knee R.SH1 R.SH2 R.SH3 R.Ankle
        R.Heel R.MT1 R.MT5 L.TH1 L.TH2 L.TH3 L.Knee L.SH1 L.SH2 L.SH3 L.Ankle L.Heel L.MT1 L.MT5 R_HJC L_HJC
        """,
    ),
    "rajagopal landing": (
        LEGS_AND_TRUNK,
        """
        R.Shoulder L.Shoulder R.Clavicle L.Clavicle R.ASIS L.ASIS R.PSIS S2 L.PSIS R.TH1 R.TH2 R.TH3 R.TH4 R.Knee R.SH1
        R.SH2 R.SH3 R.Ankle R.Heel R.MT5 R.Toe L.TH1 L.TH2 L.TH3 L.Knee L.SH1 L.SH2 L.SH3 L.SH4 L.Ankle L.Heel L.MT5
        L.Toe
        """,
    ),
    "rajagopal sacrum": (
        BODY,
        """
        R.Shoulder R.Clavicle R.Bicep R.Elbow R.Forearm R.Wrist L.Shoulder L.Clavicle L.Scapula L.Bicep L.Elbow
        L.Forearm L.Wrist R.ASIS R.Iliac S2 L.Iliac L.ASIS R.TH1 R.TH2 R.TH3 R.Knee R.SH1 R.SH2 R.SH3 R.SH4 R.Ankle
        R.Heel R.MT5 L.TH1 L.TH2 L.TH3 L.TH4 L.Knee L.SH1 L.SH2 L.SH3 L.Ankle L.Heel L.MT5 R_HJC L_HJC
        """,
    ),
    "ensam jump": (
        LEGS_AND_TRUNK,
        """
        C7 MAN XYP T8 T12 COTG COTD EASG MTBassin EPSG EPSD EASD FHAG FHPG FBPG FBAG CLG CMG TFIBG THAG THPG TBPG TBAG
        MLG MMG MT5G MT1G MTPG CALG FHAD FHPD FBPD FBAD CLD CMD TFIBD THAD THPD TBPD TBAD MLD MMD MT5D MT1D MTPD CALD
        CLAVG ACG SCAPGL CLAVD ACD SCAPDL PATG PATD L5
        """,
    ),
    "uwa-full run": (
        LEGS_AND_TRUNK,
        """
        RACR C7 LACR LPSH LTH3 LCAL RPSH LTB2 RCAL RASH LMT5 LTH1 LTB1 LTB3 LMT1 RPSI CLAV RTB2 RTH2 RTH3 STRN RTH1
        RMT5 RMT1 LASI LPSI LASH RASI LTH2 RTB3 RTB1 SACR T10
        """,
    ),
    "openpose": (
        BODY,
        """
        Nose Neck LShoulder RShoulder LElbow RElbow LWrist RWrist LHip RHip LKnee RKnee LAnkle RAnkle
        LBigToe LSmallToe LHeel RBigToe RSmallToe RHeel CHip
        """,
    ),
    "openpose COCO": (
        BODY,
        """
        Nose Neck LShoulder RShoulder LElbow RElbow LWrist RWrist LHip RHip LKnee RKnee LAnkle RAnkle
        """,
    ),
    "suprasternale": (
        BODY,
        """
        HV OCC LTEMP RTEMP SEL C7 T10 SUP STR LA LLHE LMHE LUS LRS LHMH5 LHMH2 LFT3 RA RLHE RMHE RUS RRS
        RHMH5 RHMH2 RFT3 LPSIS RPSIS LASIS RASIS LGT LLFE LMFE LLM LSPH LCAL LMFH5 LMFH1 LTT2 RGT RLFE RMFE
        RLM RSPH RCAL RMFH5 RMFH1 RTT2 LATT RATT
        """,
    ),
    "suprasternale legs": (
        LEGS_AND_TRUNK,
        "LA LASIS LLFE LLM LMFE LPSIS LSPH LTT2 RA RASIS RLFE RLM RMFE RPSIS RSPH RTT2 U1 U2 U3 U4",
    ),
    "numbered-feet": (
        BODY,
        """
        LASI RASI LKNE LTHI1 LTHI2 LTHI3 LTIB1 LTIB2 foot_l6 foot_l9 RTHI3 RANK RTIB1 RTIB2 RTIB3 Foot_r3 Foot_r5
        Foot_r6 Foot_r7 Foot_r9 RSHO LSHO rad_l2 hum_r2 rad_r2 RH CLAV RW1 LH LW1 hum_l2 RKNE Foot_r8 RELB LKNE_med
        Foot_r4 LANK RW2 foot_l5 LTIB3 RTHI2 foot_l8 foot_l7 LW2 foot_l4 RKNE_med RANK_med Foot_r10 RPSI RTHI1
        LANK_med LPSI Foot_r1 Foot_r2 LELB foot_l1 foot_l2 foot_l10 foot_l3
        """,
    ),
    "running-clusters": (
        LEGS,
        """
        pelvis_1 pelvis_2 pelvis_3 pelvis_4 L_thigh_1 L_thigh_2 L_thigh_3 L_thigh_4 R_thigh_1 R_thigh_2 R_thigh_3
        R_thigh_4 L_shank_1 L_shank_2 L_shank_3 L_shank_4 R_shank_1 R_shank_2 R_shank_3 R_shank_4 L_foot_1 L_foot_2
        L_foot_3 L_foot_4 R_foot_1 R_foot_2 R_foot_3 R_foot_4
        """,
    ),
    "running-clusters static": (
        LEGS,
        """
        pelvis_1 pelvis_2 pelvis_3 pelvis_4 L_thigh_1 L_thigh_2 L_thigh_3 L_thigh_4 R_thigh_1 R_thigh_2 R_thigh_3
        R_thigh_4 L_shank_1 L_shank_2 L_shank_3 L_shank_4 R_shank_1 R_shank_2 R_shank_3 R_shank_4 L_foot_1 L_foot_2
        L_foot_3 L_foot_4 R_foot_1 R_foot_2 R_foot_3 R_foot_4 L_hip R_hip L_lat_knee L_med_knee R_med_knee
        R_lat_knee L_lat_ankle L_med_ankle R_med_ankle R_lat_ankle
        """,
    ),
    "limb-clusters": (
        LEGS_AND_TRUNK,
        """
        LPSIS LASIS R_PEL_L R_PEL_U L_PEL_U L_PEL_L L_THI_1 L_THI_2 L_THI_3 L_THI_4 L_LEG_1 L_LEG_2 L_LEG_3
        L_LEG_4 LMT1 LMT5 LMT2 L_LCALC R_THI_1 R_LEG_1 R_LEG_2 R_LEG_4 RMT1 RMT5 RMT2 R_MCALC R_LCALC C7 RACR
        CLAV LACR T10 STRN R_THI_2 R_THI_3 RASIS R_THI_4 R_LEG_3 R_CALC RPSIS L_CALC L_MCALC LLMA RLMA LLKNE
        RLKNE
        """,
    ),
    "plug-in-gait neck": (
        BODY,
        """
        LMAS RMAS GLAB T2 T10 CLAV RBAK LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA RWRB RFIN
        LASI RASI LPSI RPSI LTHI LKNE LKNM LTIB LANK LMED LHEE LTOE RTHI RKNE RKNM RTIB RANK RMED RHEE RTOE
        """,
    ),
    "mediapipe": (
        BODY,
        """
        nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow right_elbow
        left_wrist right_wrist left_hip right_hip left_knee right_knee left_ankle right_ankle left_heel
        right_heel left_foot_index right_foot_index
        """,
    ),
    "hip-markers": (
        BODY,
        """
        Head L_Shoulder L_Elbow L_Wrist R_Shoulder R_Elbow R_Wrist L_Hip L_Knee L_Ankle L_Heel L_Meta_V L_Toe_II
        R_Hip R_Knee R_Ankle R_Heel R_Meta_V R_Toe_II
        """,
    ),
    "skeleton": (
        BODY,
        """
        Body Hips RightThigh RightLeg RightFoot RightToe RightToeEnd RightHeel LeftThigh LeftLeg LeftFoot
        LeftToe LeftToeEnd LeftHeel SpineLow Chest RightShoulder RightArm RightForearm RightHand
        LeftShoulder LeftArm LeftForearm LeftHand Neck Head HeadEnd
        """,
    ),
}
